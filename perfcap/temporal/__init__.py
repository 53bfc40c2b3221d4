"""The time axis."""

from perfcap.temporal.subspace import dct_basis, project, project_out
from perfcap.temporal.window import (
    Blender,
    Window,
    blend_rotations,
    blend_vectors,
    blend_weights,
    mean_rotations,
    mean_vectors,
    partition,
)

__all__ = [
    "Blender",
    "Window",
    "blend_rotations",
    "blend_vectors",
    "blend_weights",
    "dct_basis",
    "mean_rotations",
    "mean_vectors",
    "partition",
    "project",
    "project_out",
]
