"""Bare meshes to actors: direction, joints, weights, shape."""

from perfcap.rigging.auto_rig import RigReport, auto_rig, rig_with_joints
from perfcap.rigging.bone_heat import HeatReport, bone_heat_weights
from perfcap.rigging.bones import Bones, skeleton_bones
from perfcap.rigging.build_body import BuiltBody, Person, build_body
from perfcap.rigging.fit_body import BodyFit, fit_body
from perfcap.rigging.fit_surface import BodyFitter, FitSettings, SurfaceFit
from perfcap.rigging.overrides import Override, read_overrides
from perfcap.rigging.person_masks import PersonMasks
from perfcap.rigging.upright import Upright
from perfcap.rigging.view_fit import ViewFitSettings

__all__ = [
    "BodyFit",
    "BodyFitter",
    "Bones",
    "BuiltBody",
    "FitSettings",
    "HeatReport",
    "Override",
    "Person",
    "PersonMasks",
    "RigReport",
    "SurfaceFit",
    "Upright",
    "ViewFitSettings",
    "auto_rig",
    "bone_heat_weights",
    "build_body",
    "fit_body",
    "read_overrides",
    "rig_with_joints",
    "skeleton_bones",
]
