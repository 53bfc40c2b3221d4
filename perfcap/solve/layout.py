"""How a tangent vector (frames and shared part, any batch) lies in a matrix of unknowns (B, N)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.solve.energy import State, Step, seen_columns


@dataclass(frozen=True)
class Layout:
    """Sizes of a state: ``batch`` = *b with product B, F, D and S; N = F * D + S unknowns.

    ``shared_sizes`` are names and sizes of the shared blocks, in their order.

    Inside the solver every batch is flattened to B and a tangent vector is a row of N numbers:
    all unknowns of frame 0, of frame 1, ..., and the shared ones last.
    """

    batch: torch.Size
    frames: int
    frame_dim: int
    shared_sizes: tuple[tuple[str, int], ...] = ()

    @classmethod
    def of(cls, state: State) -> Layout:
        """The layout of a state."""
        shape = state.coordinates().frame.shape
        sizes = tuple(state.shared_sizes.items())
        return cls(shape[:-2], shape[-2], state.frame_dim, sizes)

    @property
    def shared_dim(self) -> int:
        """S, unknowns that all frames share."""
        return sum(size for _, size in self.shared_sizes)

    def seen(self, names: Collection[str]) -> slice | list[int]:
        """Which of the S shared unknowns the named blocks are."""
        return seen_columns(dict(self.shared_sizes), names)

    @property
    def batch_size(self) -> int:
        """B, batch elements in all; 1 for a state without a batch."""
        return self.batch.numel()

    @property
    def frame_unknowns(self) -> int:
        """F * D, unknowns before the shared ones."""
        return self.frames * self.frame_dim

    @property
    def unknowns(self) -> int:
        """N, all unknowns of a batch element."""
        return self.frame_unknowns + self.shared_dim

    def flatten(self, step: Step) -> Tensor:
        """Rows (B, N) of a tangent vector; parts may be broadcastable, as bounds are."""
        frame = step.frame.expand(*self.batch, self.frames, self.frame_dim)
        flat = frame.reshape(self.batch_size, self.frame_unknowns)
        if not self.shared_dim:
            return flat
        shared = step.shared.expand(*self.batch, self.shared_dim)
        return torch.cat((flat, shared.reshape(self.batch_size, self.shared_dim)), -1)

    def unflatten(self, rows: Tensor) -> Step:
        """Tangent vector of rows (B, N): the inverse of ``flatten``."""
        frame, shared = self.split(rows)
        return Step(frame.reshape(*self.batch, *frame.shape[1:]), shared.reshape(*self.batch, -1))

    def split(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Rows (B, N) as frames (B, F, D) and shared unknowns (B, S)."""
        frame = rows[:, : self.frame_unknowns].reshape(-1, self.frames, self.frame_dim)
        return frame, rows[:, self.frame_unknowns :]

    def per_element(self, values: Tensor) -> Tensor:
        """Values (*b, ...) or broadcastable to *b, flattened to (B, ...) over the batch."""
        trailing = values.shape[len(self.batch) :]
        return values.expand((*self.batch, *trailing)).reshape(self.batch_size, *trailing)
