"""Skinning weights, prepared once for blending many poses.

A blend sums a few rows of a small table for every vertex: a product with a sparse matrix. As such
it runs three times faster, and its derivative five times, than gathering and summing.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from perfcap.errors import InputError


class SkinWeights(nn.Module):
    """How much each bone moves each vertex; constant, so not differentiated.

    Vertices that share their heaviest bone, the *pivot*, also share the sign every other bone's
    quaternion takes, so tables have a row for each of the P pairs (pivot, bone) that occur.

    Args:
        weights: dense (V, B), or sparse (V, K) with ``weight_index``; not negative, usually
            summing to one over bones. A bone may occur twice in a row; its weights add.
        weight_index: bone of each sparse weight, (V, K) integer.
    """

    pivots: Tensor  # P
    bones: Tensor  # P

    def __init__(self, weights: Tensor, weight_index: Tensor | None = None) -> None:
        super().__init__()
        weights = weights.detach()
        if weight_index is None:
            every = torch.arange(weights.shape[-1], device=weights.device)
            weight_index, total = every.expand_as(weights), weights
            _check(weights, weight_index)
        else:
            _check(weights, weight_index)
            total = _merged(weights, weight_index)
        self.vertices = len(weights)
        self.least_bones = int(weight_index.max()) + 1
        pivot = weight_index.gather(1, total.argmax(1, keepdim=True)).squeeze(1)
        row, slot = weights.nonzero(as_tuple=True)
        pairs = pivot[row] * self.least_bones + weight_index[row, slot]
        pairs, column = torch.unique(pairs, return_inverse=True)
        self.register_buffer("pivots", pairs // self.least_bones, persistent=False)
        self.register_buffer("bones", pairs % self.least_bones, persistent=False)
        # once each: a graphics card multiplies rows wrongly that name a column twice
        entries, place = torch.unique(row * len(pairs) + column, return_inverse=True)
        values = weights.new_zeros(len(entries)).index_add(0, place, weights[row, slot])
        row, column = entries // len(pairs), entries % len(pairs)
        self._register("matrix", row, column, values, (self.vertices, len(pairs)))
        self._register("transpose", column, row, values, (len(pairs), self.vertices))

    def forward(self, table: Tensor) -> Tensor:
        """Weighted sum (V, D) of the rows of a table (P, D), for each vertex."""
        self._check_type(table)
        size = (self.vertices, len(self.pivots))
        there = self._matrix("matrix", size)
        back = self._matrix("transpose", size[::-1])
        result: Tensor = _Product.apply(table, there, back)  # type: ignore[no-untyped-call]
        return result

    def rows(self) -> tuple[Tensor, Tensor, Tensor]:
        """What moves each vertex, for code that needs a few vertices rather than all.

        Returns:
            bones: (V, K), any where a vertex has fewer than K.
            weights: (V, K), 0 there.
            pivots: (V,), the heaviest bone.
        """
        end, column, value = (self.get_buffer(f"matrix_{p}") for p in ("end", "column", "value"))
        slot = torch.arange(int(end.diff().max())).to(end)
        entry = end[:-1, None] + slot
        used = entry < end[1:, None]
        pair = column[entry.clamp(max=len(column) - 1)]
        weights = torch.where(used, value[entry.clamp(max=len(value) - 1)], 0)
        return self.bones[pair], weights, self.pivots[pair[:, 0]]

    def _check_type(self, table: Tensor) -> None:
        own = self.get_buffer("matrix_value")
        if (own.dtype, own.device) != (table.dtype, table.device):
            raise InputError(
                f"skinning weights are {own.dtype} on {own.device} but transforms {table.dtype} on "
                f"{table.device}; move one with .to()"
            )

    def _register(
        self, name: str, row: Tensor, column: Tensor, value: Tensor, size: tuple[int, int]
    ) -> None:
        """Keep a matrix as plain buffers in compressed rows: these move, copy and pickle."""
        order = (row * size[1] + column).argsort()
        counts = torch.bincount(row, minlength=size[0])
        ends = torch.cat((counts.new_zeros(1), counts.cumsum(0)))
        parts = {"end": ends, "column": column[order], "value": value[order]}
        for part, tensor in parts.items():
            self.register_buffer(f"{name}_{part}", tensor, persistent=False)

    def _matrix(self, name: str, size: tuple[int, int]) -> _Sparse:
        end, column, value = (self.get_buffer(f"{name}_{p}") for p in ("end", "column", "value"))
        return _Sparse(end, column, value, size)


@dataclass(frozen=True)
class _Sparse:
    """A matrix in compressed rows; opaque to torch.func, which knows no sparse tensors."""

    end: Tensor
    column: Tensor
    value: Tensor
    size: tuple[int, int]

    def times(self, table: Tensor) -> Tensor:
        with warnings.catch_warnings():  # torch calls its compressed rows beta, once a process
            warnings.filterwarnings("ignore", "Sparse", UserWarning)
            matrix = torch.sparse_csr_tensor(
                self.end, self.column, self.value, self.size, check_invariants=False
            )
        return matrix @ table


class _Product(torch.autograd.Function):
    """Constant sparse matrix times table, to any order, forward, reverse and under vmap."""

    @staticmethod
    def forward(table: Tensor, there: _Sparse, back: _Sparse) -> Tensor:
        return there.times(table)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, _Sparse, _Sparse], output: Tensor) -> None:
        _, ctx.there, ctx.back = inputs

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        return _Product.apply(gradients[0], ctx.back, ctx.there), None, None  # type: ignore

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Tensor:
        return _Product.apply(tangents[0], ctx.there, ctx.back)  # type: ignore

    @staticmethod
    def vmap(
        info: Any, dims: tuple[Any, ...], table: Tensor, there: _Sparse, back: _Sparse
    ) -> tuple[Tensor, int]:
        columns = table.movedim(dims[0], -1)
        result: Tensor = _Product.apply(columns.flatten(1), there, back)  # type: ignore
        return result.reshape(-1, *columns.shape[1:]), columns.dim() - 1


def _merged(weights: Tensor, weight_index: Tensor) -> Tensor:
    """Total weight (V, K) of the bone in each slot, over all slots of the vertex it occurs in."""
    same = weight_index.unsqueeze(-1) == weight_index.unsqueeze(-2)  # V K K
    return (same * weights.unsqueeze(-2)).sum(-1)


def _check(weights: Tensor, weight_index: Tensor) -> None:
    if weights.dim() != 2 or weights.shape != weight_index.shape:
        raise InputError(
            f"weights have shape {tuple(weights.shape)} and weight_index "
            f"{tuple(weight_index.shape)}; give both as (V, K), or dense weights (V, B) alone"
        )
    if weight_index.is_floating_point() or (weight_index < 0).any():
        raise InputError("weight_index holds negative or fractional numbers; give bone indices")
    bad = ~((weights >= 0).all(1) & weights.isfinite().all(1) & (weights.sum(1) > 0))
    if bad.any():
        raise InputError(
            f"weights of vertex {int(bad.nonzero()[0])} ({int(bad.sum())} such vertices) are "
            "negative, not finite or all zero; give each vertex a bone"
        )
