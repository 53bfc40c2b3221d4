"""The time axis."""

from perfcap.temporal.smoothing import (
    Smoother,
    binomial,
    box,
    smooth_rotations,
    smooth_vectors,
)
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
    "Smoother",
    "Window",
    "binomial",
    "blend_rotations",
    "blend_vectors",
    "blend_weights",
    "box",
    "dct_basis",
    "mean_rotations",
    "mean_vectors",
    "partition",
    "project",
    "project_out",
    "smooth_rotations",
    "smooth_vectors",
]
