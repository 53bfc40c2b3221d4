"""Normal equations of projected points as compiled loops, for plain tensors on the CPU.

Says the same as ``Reprojection.linearize`` followed by the sum of its rows, which tests hold it
equal to, without a Jacobian of the pixels: the views of a point add up to a 3 x 3 matrix first.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.kernels import inner, kernel
from perfcap.solve._robust_numba import Robust, robust

Floats = NDArray[np.floating[Any]]


def add_to_blocks(
    seen: Detections,
    strength: tuple[Tensor, Tensor],
    projected: tuple[Tensor, Tensor],
    moved: Tensor,
    kernel: Robust,
    blocks: tuple[Tensor, Tensor],
) -> Tensor:
    """Add to curvature and gradient; the energy of each batch element, (B,).

    Args:
        seen: detections of N points.
        strength: scale of each view and weight of the energy.
        projected: pixels (*b, F, C, N, 2) and their derivative (*b, F, C, N, 2, 3).
        moved: derivative of the points, (*b, F, N, 3, D).
        kernel: of the energy.
        blocks: curvature (B, F, D, D) and gradient (B, F, D).
    """
    pixels, camera = projected
    curvature, gradient = blocks
    batch, _, dim = gradient.shape
    views, count = pixels.shape[-3:-1]
    value = gradient.new_zeros(batch)
    scale, weight = strength
    _add_to_blocks(
        _rows(pixels, views, count, 2),
        _rows(seen.joints2d, views, count, 2),
        _rows(seen.confidence2d, views, count),
        _rows(scale.expand(pixels.shape[:-2]), views),
        _rows(camera, views, count, 2, 3),
        _rows(moved, count, 3, dim),
        _rows(weight.to(gradient).expand(pixels.shape[:-4])),
        kernel,
        curvature.numpy().reshape(-1, dim, dim),
        gradient.numpy().reshape(-1, dim),
        value.numpy(),
    )
    return value


def _rows(tensor: Tensor, *shape: int) -> Floats:
    """Contiguous, as another memory layout would compile the kernel once more."""
    return np.ascontiguousarray(tensor.detach().numpy()).reshape(-1, *shape)


@kernel()
def _add_to_blocks(
    pixels: Floats,
    detected: Floats,
    confidence: Floats,
    scale: Floats,
    camera: Floats,
    moved: Floats,
    weight: Floats,
    kernel: Robust,
    curvature: Floats,
    gradient: Floats,
    value: Floats,
) -> None:
    """All frames, one after the other."""
    frames = len(pixels) // len(weight)
    stiff, pull = np.empty((3, 3), pixels.dtype), np.empty(3, pixels.dtype)
    for n in range(len(pixels)):
        share, cost = weight[n // frames], 0.0
        for j in range(pixels.shape[2]):
            stiff[:], pull[:] = 0, 0
            for view in range(pixels.shape[1]):
                unit = scale[n, view]
                x = unit * (pixels[n, view, j, 0] - detected[n, view, j, 0])
                y = unit * (pixels[n, view, j, 1] - detected[n, view, j, 1])
                trust = confidence[n, view, j]
                own, slope = robust(kernel, trust * (x * x + y * y))
                cost += own
                strength = share * trust * slope
                if strength != 0:
                    across, down = camera[n, view, j, 0], camera[n, view, j, 1]
                    for a in range(3):
                        pull[a] += strength * unit * (x * across[a] + y * down[a])
                        for b in range(3):
                            both = across[a] * across[b] + down[a] * down[b]
                            stiff[a, b] += strength * unit * unit * both
            add_point(moved[n, j], stiff, pull, curvature[n], gradient[n])
        value[n // frames] += share * cost


@inner(fastmath={"contract"})
def add_point(
    moved: Floats, stiff: Floats, pull: Floats, curvature: Floats, gradient: Floats
) -> None:
    """Add ``J' W J`` and ``J' p`` of one point, J (3, D), W (3, 3), p (3,)."""
    dim = len(gradient)
    turned = np.empty((3, dim), moved.dtype)
    for a in range(3):
        first, second, third = stiff[a, 0], stiff[a, 1], stiff[a, 2]
        for k in range(dim):
            turned[a, k] = first * moved[0, k] + second * moved[1, k] + third * moved[2, k]
    for i in range(dim):
        first, second, third = moved[0, i], moved[1, i], moved[2, i]
        if first != 0 or second != 0 or third != 0:
            gradient[i] += first * pull[0] + second * pull[1] + third * pull[2]
            row = curvature[i]
            for k in range(dim):
                row[k] += first * turned[0, k] + second * turned[1, k] + third * turned[2, k]
