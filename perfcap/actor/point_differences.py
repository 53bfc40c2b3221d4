"""Vectors between points of a person: where one is as seen from another."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import torch
from torch import Tensor, nn

from perfcap.actor.motion import Motion
from perfcap.actor.points import Linearized, OffersCurvature, Points
from perfcap.errors import InputError
from perfcap.solve.second_order import SecondOrder, twice_differentiated


class PointDifferences(nn.Module):
    """Points minus other points, as points that energies take: bones, reaches, orientations.

    Args:
        points: N points of a person.
        ends: which of them the vectors lead to, M.
        starts: which they start at, M; None for a point that is taken as it is.

    Raises:
        InputError: other numbers of ends and starts, or points that are not there.
    """

    sees: Collection[str]
    ends: Tensor
    starts: Tensor
    relative: Tensor

    def __init__(self, points: Points, ends: Sequence[int], starts: Sequence[int | None]) -> None:
        super().__init__()
        used = [*ends, *(start for start in starts if start is not None)]
        if len(ends) != len(starts) or not all(0 <= each < points.count for each in used):
            raise InputError(
                f"ends {list(ends)} and starts {list(starts)}: expected as many of each, from 0 to "
                f"{points.count - 1}"
            )
        self.points, self.sees = points, points.sees
        self.register_buffer("ends", torch.tensor(list(ends)))
        self.register_buffer("starts", torch.tensor([start or 0 for start in starts]))
        self.register_buffer("relative", torch.tensor([start is not None for start in starts]))

    @property
    def count(self) -> int:
        """M."""
        return len(self.ends)

    def forward(self, motion: Motion) -> Tensor:
        """Vectors in the world, (*b, F, M, 3), metres."""
        return self._between(self.points(motion), -2)

    def linearize(self, motion: Motion) -> Linearized:
        """The same differences of the points' derivatives."""
        points, frame, shared = self.points.linearize(motion)
        return (
            self._between(points, -2),
            self._between(frame, -3),
            None if shared is None else self._between(shared, -3),
        )

    def curvature(self, motion: Motion, linearized: Linearized, pull: Tensor) -> SecondOrder:
        """Second derivative of ``<pull, vectors>`` for a pull (*b, F, M, 3)."""
        count = self.points.count
        on_points = pull.new_zeros(*pull.shape[:-2], count, 3).index_add(-2, self.ends, pull)
        kept = pull * self.relative.to(pull)[:, None]
        on_points = on_points.index_add(-2, self.starts, -kept)
        if isinstance(self.points, OffersCurvature):
            return self.points.curvature(motion, self.points.linearize(motion), on_points)
        return twice_differentiated(self.points, motion, on_points)

    def _between(self, values: Tensor, axis: int) -> Tensor:
        """Rows of the ends minus those of the starts, along an axis counted from the end."""
        shape = (-1,) + (1,) * (-1 - axis)
        start = values.index_select(axis, self.starts) * self.relative.to(values).reshape(shape)
        return values.index_select(axis, self.ends) - start
