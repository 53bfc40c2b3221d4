"""Bare meshes to actors: direction, joints, weights, shape."""

from perfcap.rigging.auto_rig import BareMesh, RigReport, auto_rig, rig_with_joints
from perfcap.rigging.bone_heat import HeatReport, bone_heat_weights
from perfcap.rigging.bones import Bones, skeleton_bones
from perfcap.rigging.fit_body import BodyFit, ViewFitSettings, fit_body
from perfcap.rigging.fit_surface import BodyFitter, FitSettings, SurfaceFit
from perfcap.rigging.overrides import Override, read_overrides
from perfcap.rigging.upright import Upright

__all__ = [
    "BareMesh",
    "BodyFit",
    "BodyFitter",
    "Bones",
    "FitSettings",
    "HeatReport",
    "Override",
    "RigReport",
    "SurfaceFit",
    "Upright",
    "ViewFitSettings",
    "auto_rig",
    "bone_heat_weights",
    "fit_body",
    "read_overrides",
    "rig_with_joints",
    "skeleton_bones",
]
