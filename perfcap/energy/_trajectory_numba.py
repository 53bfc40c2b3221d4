"""Features of trajectories and their derivatives as compiled loops, for plain tensors on the CPU.

Says the same as ``Trajectory`` in torch, which tests hold it equal to.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.geometry._rotation_numba import quaternion_of
from perfcap.kernels import inner, kernel

Floats = NDArray[np.floating[Any]]


def linearize_features(
    scale: tuple[Tensor, Tensor, Tensor], motion: Motion
) -> tuple[Tensor, Tensor]:
    """See ``Trajectory.linearize_features``; scales of translation, rotation and angles."""
    *lead, frames, count = motion.angles.shape
    features = motion.angles.new_empty(*lead, frames, 7 + count)
    jacobian = motion.angles.new_zeros(*lead, frames, 7 + count, 6 + count)
    scales = motion.angles.new_empty(*lead, 1, 7 + count)
    scales[..., :3], scales[..., 3:7], scales[..., 7:] = scale[0], 2 * scale[1], scale[2]
    _linearize(
        scales.numpy().reshape(-1, 7 + count),
        *(_rows(x, frames) for x in (motion.translation, motion.rotation, motion.angles)),
        features.numpy().reshape(-1, frames, 7 + count),
        jacobian.numpy().reshape(-1, frames, 7 + count, 6 + count),
    )
    return features, jacobian


def _rows(tensor: Tensor, frames: int) -> Floats:
    """Contiguous, as another memory layout would compile the kernel once more."""
    return np.ascontiguousarray(tensor.detach().numpy()).reshape(-1, frames, tensor.shape[-1])


@kernel()
def _linearize(
    scales: Floats,
    translation: Floats,
    rotation: Floats,
    angles: Floats,
    features: Floats,
    jacobian: Floats,
) -> None:
    """Features (N, F, 7 + A) and their derivative (N, F, 7 + A, 6 + A), which comes as zeros."""
    count = angles.shape[2]
    for n in range(len(angles)):
        for f in range(angles.shape[1]):
            for i in range(3):
                features[n, f, i] = scales[n, i] * translation[n, f, i]
                jacobian[n, f, i, i] = scales[n, i]
            for i in range(count):
                features[n, f, 7 + i] = scales[n, 7 + i] * angles[n, f, i]
                jacobian[n, f, 7 + i, 6 + i] = scales[n, 7 + i]
            w, x, y, z = quaternion_of(rotation[n], f)
            if f > 0:
                before = features[n, f - 1, 3:7]
                if w * before[0] + x * before[1] + y * before[2] + z * before[3] < 0:
                    w, x, y, z = -w, -x, -y, -z
            _place_quaternion(scales[n, 3], w, x, y, z, features[n, f], jacobian[n, f])


@inner()
def _place_quaternion(
    scale: float, w: float, x: float, y: float, z: float, features: Floats, jacobian: Floats
) -> None:
    """``scale q`` and its derivative in a left rotation: half of the columns (0, e_k) q."""
    w, x, y, z = scale * w, scale * x, scale * y, scale * z
    features[3], features[4], features[5], features[6] = w, x, y, z
    jacobian[3, 3], jacobian[3, 4], jacobian[3, 5] = -0.5 * x, -0.5 * y, -0.5 * z
    jacobian[4, 3], jacobian[4, 4], jacobian[4, 5] = 0.5 * w, 0.5 * z, -0.5 * y
    jacobian[5, 3], jacobian[5, 4], jacobian[5, 5] = -0.5 * z, 0.5 * w, 0.5 * x
    jacobian[6, 3], jacobian[6, 4], jacobian[6, 5] = 0.5 * y, -0.5 * x, 0.5 * w
