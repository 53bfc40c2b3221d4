"""Projection and its derivative as compiled loops, for plain tensors on the CPU.

Says the same as ``Camera.linearize`` in torch, which tests hold it equal to.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import inner, kernel

Floats = NDArray[np.floating[Any]]


class Views(NamedTuple):
    """Cameras of M frames, or of one that stands for all; no rows where nothing is distorted."""

    intrinsics: Floats  # (M, C, 3, 3)
    rotation: Floats  # (M, C, 3, 3)
    translation: Floats  # (M, C, 3)
    distortion: Floats  # (M, C, 5)
    limit: Floats  # (M, C, 1)


def linearize(
    points: Tensor,
    pinhole: tuple[Tensor, Tensor, Tensor],
    lens: tuple[Tensor, Tensor] | None,
    near: float,
) -> tuple[Tensor, Tensor]:
    """Pixels (*b, F, C, N, 2) and derivative (*b, F, C, N, 2, 3); see ``Camera.linearize``.

    Args:
        points: (*b, F, N, 3).
        pinhole: intrinsics, rotation and translation of C views.
        lens: distortion, and the squared radius beyond which it is held constant.
        near: depth at which nearer points are projected.
    """
    *lead, count, _ = points.shape
    intrinsics, rotation, translation = pinhole
    views = translation.shape[-2]
    place = _rows(points, count, 3)
    none = place[:0]  # of the same type
    arrays = Views(
        _rows(intrinsics, views, 3, 3),
        _rows(rotation, views, 3, 3),
        _rows(translation, views, 3),
        none if lens is None else _rows(lens[0], views, 5),
        none if lens is None else _rows(lens[1], views, 1),
    )
    pixels = points.new_empty(*lead, views, count, 2)
    jacobian = points.new_empty(*lead, views, count, 2, 3)
    _linearize(
        arrays,
        place,
        near,
        pixels.numpy().reshape(-1, views, count, 2),
        jacobian.numpy().reshape(-1, views, count, 2, 3),
    )
    return pixels, jacobian


def _rows(tensor: Tensor, *shape: int) -> Floats:
    """Contiguous, as another memory layout would compile the kernel once more."""
    return np.ascontiguousarray(tensor.detach().numpy()).reshape(-1, *shape)


@kernel()
def _linearize(views: Views, points: Floats, near: float, pixels: Floats, jacobian: Floats) -> None:
    """All points of all frames in all views."""
    for frame in range(len(points)):
        for view in range(pixels.shape[1]):
            for n in range(points.shape[1]):
                _project(views, frame, view, points, n, near, pixels, jacobian)


@inner()
def _project(
    views: Views,
    frame: int,
    view: int,
    points: Floats,
    n: int,
    near: float,
    pixels: Floats,
    jacobian: Floats,
) -> None:
    """One point: camera axes, plane z = 1, distortion, pixels."""
    m = frame % len(views.rotation)
    x = _local(views, m, view, points, frame, n, 0)
    y = _local(views, m, view, points, frame, n, 1)
    z = _local(views, m, view, points, frame, n, 2)
    r, k, d = views.rotation, views.intrinsics, views.distortion
    scale = 1 / max(z, near)
    towards = 1.0 if z > near else 0.0
    x, y = x * scale, y * scale
    bent, (xx, xy, yx, yy) = (x, y), (1.0, 0.0, 0.0, 1.0)
    if len(d) > 0:
        coefficients = d[m, view, 0], d[m, view, 1], d[m, view, 2], d[m, view, 3], d[m, view, 4]
        bent, (xx, xy, yx, yy) = _distort(x, y, coefficients, views.limit[m, view, 0])
    for i in range(2):
        a, b = k[m, view, i, 0], k[m, view, i, 1]
        pixels[frame, view, n, i] = a * bent[0] + b * bent[1] + k[m, view, i, 2]
        along_x, along_y = a * xx + b * yx, a * xy + b * yy
        for c in range(3):
            depth = towards * r[m, view, 2, c]
            jacobian[frame, view, n, i, c] = scale * (
                along_x * (r[m, view, 0, c] - x * depth) + along_y * (r[m, view, 1, c] - y * depth)
            )


@inner()
def _local(views: Views, m: int, view: int, points: Floats, frame: int, n: int, axis: int) -> float:
    """A camera coordinate of a point."""
    r = views.rotation
    coordinate: float = (
        r[m, view, axis, 0] * points[frame, n, 0]
        + r[m, view, axis, 1] * points[frame, n, 1]
        + r[m, view, axis, 2] * points[frame, n, 2]
        + views.translation[m, view, axis]
    )
    return coordinate


@inner()
def _distort(
    x: float, y: float, coefficients: tuple[float, ...], limit: float
) -> tuple[tuple[float, float], tuple[float, float, float, float]]:
    """Distorted plane coordinates and their derivative, row by row; see ``Camera._distort``.

    Beyond the limit the squared radius r2 is constant; ``turn`` = r2 / (x^2 + y^2) then shrinks.
    """
    k1, k2, p1, p2, k3 = coefficients
    full = x * x + y * y
    r2 = min(full, limit)
    turn = r2 / max(full, 1e-12)
    if full <= limit:
        r2_x, r2_y, turn_x, turn_y = 2 * x, 2 * y, 0.0, 0.0
        turn = 1.0
    else:
        r2_x, r2_y, turn_x, turn_y = 0.0, 0.0, -2 * x * turn / full, -2 * y * turn / full
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2 * k2 + 3 * r2 * k3)
    xy = 2 * x * y
    bent = (
        x * radial + p1 * xy * turn + p2 * (r2 + 2 * x * x * turn),
        y * radial + p2 * xy * turn + p1 * (r2 + 2 * y * y * turn),
    )
    derivative = (
        radial + x * slope * r2_x + p1 * (2 * y * turn + xy * turn_x)
        + p2 * (r2_x + 4 * x * turn + 2 * x * x * turn_x),
        x * slope * r2_y + p1 * (2 * x * turn + xy * turn_y) + p2 * (r2_y + 2 * x * x * turn_y),
        y * slope * r2_x + p2 * (2 * y * turn + xy * turn_x) + p1 * (r2_x + 2 * y * y * turn_x),
        radial + y * slope * r2_y + p2 * (2 * x * turn + xy * turn_y)
        + p1 * (r2_y + 4 * y * turn + 2 * y * y * turn_y),
    )  # fmt: skip
    return bent, derivative
