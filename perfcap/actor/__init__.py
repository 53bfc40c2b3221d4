"""What moves: motion, skeleton, skinning, actor."""

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import human_rig
from perfcap.actor.bare_mesh import BareMesh
from perfcap.actor.bone_map import BoneMap, map_bones
from perfcap.actor.deformation import Deformation
from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.actor.deformed_surface import DeformedSurface
from perfcap.actor.embedded_points import EmbeddedPoints
from perfcap.actor.kinematic_tree import Pose
from perfcap.actor.motion import Motion
from perfcap.actor.points import Landmarks, PointDifferences, Points
from perfcap.actor.rig import Hinge, Rig
from perfcap.actor.rig_reader import read_urdf
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.actor.shaped_volume import ShapedGaussians
from perfcap.actor.skeleton import Skeleton
from perfcap.actor.skinning import dual_quaternion_blend, linear_blend
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.actor.template import Template
from perfcap.actor.volume import GaussianCentres, Volume
from perfcap.actor.volume_fit import fit_volume

__all__ = [
    "Actor",
    "BareMesh",
    "BoneMap",
    "Deformation",
    "DeformationGraph",
    "DeformedSurface",
    "EmbeddedPoints",
    "GaussianCentres",
    "Hinge",
    "Landmarks",
    "Motion",
    "PointDifferences",
    "Points",
    "Pose",
    "Rig",
    "ShapedGaussians",
    "ShapedPoints",
    "Skeleton",
    "SkinnedPoints",
    "Template",
    "Volume",
    "dual_quaternion_blend",
    "fit_volume",
    "human_rig",
    "linear_blend",
    "map_bones",
    "read_urdf",
]
