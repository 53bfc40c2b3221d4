"""Edges of a deformation graph as compiled loops, for plain tensors on the CPU.

Says the same as ``_rigidity_torch.py``, which tests hold it equal to.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.deformation import Deformation
from perfcap.geometry._rotation_numba import rotvec_to_matrix
from perfcap.kernels import inner, kernel
from perfcap.solve._coarse_numba import add_outer
from perfcap.solve.coarse_space import CoarseSpace

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


def stretch(
    start: Tensor, end: Tensor, rest: Tensor, scale: float, deformation: Deformation
) -> tuple[Tensor, Tensor]:
    """See ``_rigidity_torch.stretch``."""
    shape = (*deformation.rotation.shape[:-2], len(start), 3)
    gap, turned = rest.new_empty(shape), rest.new_empty(shape)
    _stretch(
        start.numpy(),
        end.numpy(),
        _rows(rest.expand(shape)),
        scale,
        _rows(deformation.rotation),
        _rows(deformation.translation),
        gap.flatten(0, -3).numpy(),
        turned.flatten(0, -3).numpy(),
    )
    return gap, turned


class EdgeCurvature:
    """See ``_rigidity_torch.EdgeCurvature``."""

    def __init__(
        self,
        start: Tensor,
        end: Tensor,
        scale: float,
        turned: Tensor,
        residual: Tensor,
        weight: Tensor,
    ) -> None:
        self.start, self.end, self.scale = start.numpy(), end.numpy(), scale
        self.turned, self.residual = _rows(turned), _rows(residual)
        self.weight = weight.detach().contiguous().numpy()

    def add_equations(self, gradient: Tensor, diagonal: Tensor) -> None:
        """See ``solve.sparse.Curvature``."""
        _add_equations(
            self.start,
            self.end,
            self.scale,
            self.turned,
            self.residual,
            self.weight,
            gradient.numpy(),
            diagonal.numpy(),
        )

    def add_product(self, direction: Tensor, product: Tensor, running: Tensor) -> None:
        """See ``solve.sparse.Curvature``."""
        _add_product(
            self.start,
            self.end,
            self.scale,
            self.turned,
            self.weight,
            direction.numpy(),
            product.numpy(),
            running.numpy(),
        )

    def add_coarse(self, space: CoarseSpace, matrix: Tensor) -> None:
        """See ``solve.sparse.Curvature``."""
        _add_coarse(
            self.start,
            self.end,
            self.scale,
            self.turned,
            self.weight,
            space.group.numpy(),
            space.modes.numpy(),
            matrix.numpy(),
            (0,) * space.modes.shape[-1],
        )


def _rows(tensor: Tensor) -> Floats:
    """(P, N, 3), contiguous, as another memory layout would compile the kernels once more."""
    return np.ascontiguousarray(tensor.detach().flatten(0, -3).numpy())


@kernel()
def _stretch(
    start: Indices,
    end: Indices,
    rest: Floats,
    scale: float,
    rotation: Floats,
    translation: Floats,
    gap: Floats,
    turned: Floats,
) -> None:
    """Edges are sorted by their start, whose rotation is made once."""
    turn = np.empty((3, 3), rest.dtype)
    for p in range(len(rest)):
        last = -1
        for g in range(len(start)):
            i, j = start[g], end[g]
            if i != last:
                rotvec_to_matrix(rotation[p], i, turn)
                last = i
            for c in range(3):
                image = (
                    turn[c, 0] * rest[p, g, 0]
                    + turn[c, 1] * rest[p, g, 1]
                    + turn[c, 2] * rest[p, g, 2]
                )
                shift = translation[p, i, c] - translation[p, j, c]
                turned[p, g, c] = image
                gap[p, g, c] = scale * shift + (rest[p, g, c] - image)


@inner()
def _pull(
    out: Floats,
    i: int,
    j: int,
    scale: float,
    edge: tuple[float, float, float],
    pull: tuple[float, float, float],
) -> None:
    """Add ``J' pull`` of one edge to (M, 6)."""
    (x, y, z), (a, b, c) = edge, pull
    out[i, 0] += b * z - c * y
    out[i, 1] += c * x - a * z
    out[i, 2] += a * y - b * x
    out[i, 3] += scale * a
    out[i, 4] += scale * b
    out[i, 5] += scale * c
    out[j, 3] -= scale * a
    out[j, 4] -= scale * b
    out[j, 5] -= scale * c


@kernel()
def _add_product(
    start: Indices,
    end: Indices,
    scale: float,
    turned: Floats,
    weight: Floats,
    direction: Floats,
    product: Floats,
    running: Flags,
) -> None:
    for p in range(len(turned)):
        if not running[p]:
            continue
        d, out = direction[p], product[p]
        for g in range(len(start)):
            i, j, w = start[g], end[g], weight[p, g]
            x, y, z = turned[p, g, 0], turned[p, g, 1], turned[p, g, 2]
            a, b, c = d[i, 0], d[i, 1], d[i, 2]
            pull = (
                w * (scale * (d[i, 3] - d[j, 3]) - (b * z - c * y)),
                w * (scale * (d[i, 4] - d[j, 4]) - (c * x - a * z)),
                w * (scale * (d[i, 5] - d[j, 5]) - (a * y - b * x)),
            )
            _pull(out, i, j, scale, (x, y, z), pull)


@kernel()
def _add_equations(
    start: Indices,
    end: Indices,
    scale: float,
    turned: Floats,
    residual: Floats,
    weight: Floats,
    gradient: Floats,
    diagonal: Floats,
) -> None:
    """The blocks of an edge e are |e|^2 I - e e', s [e] below, and s^2 I."""
    for p in range(len(turned)):
        slope = gradient[p]
        for g in range(len(start)):
            i, j, w = start[g], end[g], weight[p, g]
            x, y, z = turned[p, g, 0], turned[p, g, 1], turned[p, g, 2]
            pull = w * residual[p, g, 0], w * residual[p, g, 1], w * residual[p, g, 2]
            _pull(slope, i, j, scale, (x, y, z), pull)
            edge, square, out = (x, y, z), x * x + y * y + z * z, diagonal[p, i]
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                out[a, a] += w * (square - edge[a] * edge[a])
                out[max(a, b), min(a, b)] -= w * edge[a] * edge[b]
                out[3 + b, a] += w * scale * edge[c]
                out[3 + c, a] -= w * scale * edge[b]
                out[3 + a, 3 + a] += w * scale * scale
                diagonal[p, j, 3 + a, 3 + a] += w * scale * scale


@kernel()
def _add_coarse(
    start: Indices,
    end: Indices,
    scale: float,
    turned: Floats,
    weight: Floats,
    group: Indices,
    modes: Floats,
    matrix: Floats,
    counts: tuple[int, ...],
) -> None:
    """Edges within a group, which move with it, are left out."""
    own, rows = np.empty(2, np.int64), np.empty((2, 3, len(counts)), modes.dtype)
    for p in range(len(turned)):
        for g in range(len(start)):
            i, j, used = start[g], end[g], 0
            if group[i] == group[j]:
                continue
            if group[i] >= 0:
                own[0], used = group[i], 1
                _move_start(modes[p, i], turned[p, g], scale, rows[0], counts)
            if group[j] >= 0:
                own[used] = group[j]
                for a in range(3):
                    for m in range(len(counts)):
                        rows[used, a, m] = -scale * modes[p, j, 3 + a, m]
                used += 1
            add_outer(matrix[p], own, used, rows, weight[p, g], counts)


@inner()
def _move_start(
    modes: Floats, edge: Floats, scale: float, moved: Floats, counts: tuple[int, ...]
) -> None:
    """Write the derivative (3, r) of an edge in the modes (6, r) of the node at its start."""
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for m in range(len(counts)):
            cross = modes[b, m] * edge[c] - modes[c, m] * edge[b]
            moved[a, m] = scale * modes[3 + a, m] - cross
