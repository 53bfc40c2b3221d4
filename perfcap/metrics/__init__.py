"""Errors of results against truth."""

from perfcap.metrics.alignment import Alignment, align, root_aligned
from perfcap.metrics.contact import Penetration, floor_contact, foot_skate, penetration, skin_gap
from perfcap.metrics.girths import GirthErrors, girth_errors
from perfcap.metrics.joints import (
    JointErrors,
    action_table,
    aligned_distances,
    joint_errors,
    joint_table,
    reprojection_error,
)
from perfcap.metrics.markers import (
    MarkerError,
    MarkerSites,
    attach_markers,
    marker_error,
    marker_positions,
)
from perfcap.metrics.masks import (
    MaskOverlap,
    SilhouetteScores,
    boundary_f,
    mask_overlap,
    silhouette_scores,
)
from perfcap.metrics.mismatch import mismatches
from perfcap.metrics.mismatch_image import pixel_mismatches, silhouette_mismatches
from perfcap.metrics.mismatch_surface import surface_mismatches
from perfcap.metrics.missing import counted_joints
from perfcap.metrics.motion import (
    LimitViolations,
    acceleration_error,
    angle_error,
    bone_angle_error,
    bone_length_variation,
    jerk,
    limit_violations,
)
from perfcap.metrics.shares import (
    area_under_curve,
    correct_share,
    head_size,
    image_correct_share,
    torso_size,
)
from perfcap.metrics.surface import SurfaceError, surface_distance, surface_error, vertex_error

__all__ = [
    "Alignment",
    "GirthErrors",
    "JointErrors",
    "LimitViolations",
    "MarkerError",
    "MarkerSites",
    "MaskOverlap",
    "Penetration",
    "SilhouetteScores",
    "SurfaceError",
    "acceleration_error",
    "action_table",
    "align",
    "aligned_distances",
    "angle_error",
    "area_under_curve",
    "attach_markers",
    "bone_angle_error",
    "bone_length_variation",
    "boundary_f",
    "correct_share",
    "counted_joints",
    "floor_contact",
    "foot_skate",
    "girth_errors",
    "head_size",
    "image_correct_share",
    "jerk",
    "joint_errors",
    "joint_table",
    "limit_violations",
    "marker_error",
    "marker_positions",
    "mask_overlap",
    "mismatches",
    "penetration",
    "pixel_mismatches",
    "reprojection_error",
    "root_aligned",
    "silhouette_mismatches",
    "silhouette_scores",
    "skin_gap",
    "surface_distance",
    "surface_error",
    "surface_mismatches",
    "torso_size",
    "vertex_error",
]
