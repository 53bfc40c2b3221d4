"""Tensor maths, no people."""

from perfcap.geometry.alignment import (
    Similarity,
    nearest_rotation,
    procrustes,
    rigid_align,
    similarity_align,
)
from perfcap.geometry.camera import Camera
from perfcap.geometry.dual_quaternion import DualQuaternion
from perfcap.geometry.plain import torch_only
from perfcap.geometry.record import Record
from perfcap.geometry.rotation import (
    compose_rotvec,
    matrix_to_quaternion,
    matrix_to_rotvec,
    nearest_turn,
    quaternion_multiply,
    quaternion_to_matrix,
    quaternion_to_rotvec,
    rotvec_to_matrix,
    rotvec_to_quaternion,
    skew,
    unwrapped,
)
from perfcap.geometry.triangulation import triangulate

__all__ = [
    "Camera",
    "DualQuaternion",
    "Record",
    "Similarity",
    "compose_rotvec",
    "matrix_to_quaternion",
    "matrix_to_rotvec",
    "nearest_rotation",
    "nearest_turn",
    "procrustes",
    "quaternion_multiply",
    "quaternion_to_matrix",
    "quaternion_to_rotvec",
    "rigid_align",
    "rotvec_to_matrix",
    "rotvec_to_quaternion",
    "similarity_align",
    "skew",
    "torch_only",
    "triangulate",
    "unwrapped",
]
