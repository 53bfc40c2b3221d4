"""Errors of results against truth."""

from perfcap.metrics.joints import (
    JointErrors,
    LimitViolations,
    acceleration_error,
    bone_length_variation,
    jerk,
    joint_errors,
    limit_violations,
    reprojection_error,
)
from perfcap.metrics.masks import MaskOverlap, mask_overlap
from perfcap.metrics.surface import SurfaceError, surface_error

__all__ = [
    "JointErrors",
    "LimitViolations",
    "MaskOverlap",
    "SurfaceError",
    "acceleration_error",
    "bone_length_variation",
    "jerk",
    "joint_errors",
    "limit_violations",
    "mask_overlap",
    "reprojection_error",
    "surface_error",
]
