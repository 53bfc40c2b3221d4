"""Rotations of plain tensors on the CPU as compiled loops; see ``rotation.py`` for the maps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import inner, kernel

Floats = NDArray[np.floating[Any]]


@inner()
def quaternion_of(rotvecs: Floats, n: int) -> tuple[float, float, float, float]:
    """Unit quaternion of rotation vector n of (N, 3)."""
    x, y, z = float(rotvecs[n, 0]), float(rotvecs[n, 1]), float(rotvecs[n, 2])
    squared = x * x + y * y + z * z
    if squared < 1e-12:  # sin(a/2)/a = 1/2 - a^2/48 + O(a^4)
        return (
            1 - squared / 8,
            (0.5 - squared / 48) * x,
            (0.5 - squared / 48) * y,
            (0.5 - squared / 48) * z,
        )
    angle = math.sqrt(squared)
    factor = math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), factor * x, factor * y, factor * z


@inner()
def rotvec_to_matrix(rotvecs: Floats, n: int, matrix: Floats) -> None:
    """Write the rotation matrix (3, 3) of rotation vector n of (N, 3)."""
    w, x, y, z = quaternion_of(rotvecs, n)
    matrix[0, 0], matrix[1, 1] = 1 - 2 * (y * y + z * z), 1 - 2 * (x * x + z * z)
    matrix[0, 1], matrix[1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
    matrix[0, 2], matrix[2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
    matrix[1, 2], matrix[2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)
    matrix[2, 2] = 1 - 2 * (x * x + y * y)


def compose(left: Tensor, right: Tensor) -> Tensor:
    """See ``rotation.compose_rotvec``."""
    product = torch.empty_like(left + right, memory_format=torch.contiguous_format)
    left, right = left.detach().expand_as(product), right.detach().expand_as(product)
    # contiguous, as another memory layout would compile the kernel once more
    rows = (np.ascontiguousarray(x.numpy()).reshape(-1, 3) for x in (left, right))
    _compose(*rows, product.numpy().reshape(-1, 3))
    return product


@kernel()
def _compose(left: Floats, right: Floats, product: Floats) -> None:
    """Write the rotation vectors (N, 3) of rotating by ``right`` (N, 3), then ``left`` (N, 3)."""
    for n in range(len(product)):
        a, b, c, d = quaternion_of(left, n)
        e, f, g, h = quaternion_of(right, n)
        w = a * e - b * f - c * g - d * h
        x = a * f + e * b + c * h - d * g
        y = a * g + e * c + d * f - b * h
        z = a * h + e * d + b * g - c * f
        if w < 0:
            w, x, y, z = -w, -x, -y, -z
        squared = x * x + y * y + z * z
        if squared < 1e-12:  # 2 atan2(s, w)/s = (2/w) (1 - s^2/(3 w^2)) + O(s^4)
            factor = (2 - 2 * squared / (3 * w * w)) / w
        else:
            factor = 2 * math.atan2(math.sqrt(squared), w) / math.sqrt(squared)
        product[n, 0], product[n, 1], product[n, 2] = factor * x, factor * y, factor * z
