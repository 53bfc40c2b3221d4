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

__all__ = [
    "JointErrors",
    "LimitViolations",
    "acceleration_error",
    "bone_length_variation",
    "jerk",
    "joint_errors",
    "limit_violations",
    "reprojection_error",
]
