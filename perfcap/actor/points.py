"""Points that a motion moves: all that energies see of a person."""

from __future__ import annotations

from collections.abc import Collection
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor, nn

from perfcap.actor.kinematic_curvature import kinematic_curvature
from perfcap.actor.motion import BONES, Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.solve.second_order import SecondOrder

Linearized = tuple[Tensor, Tensor, Tensor | None]
"""Points (*b, F, N, 3), derivative (*b, F, N, 3, D), and (*b, F, N, 3, S') in what is shared."""


class Points(Protocol):
    """N points of a person: landmarks, places on the surface, of a known body or an unknown one.

    ``sees`` names the shared blocks of a motion that move them; a motion need not have these.
    """

    sees: Collection[str]

    @property
    def count(self) -> int:
        """N, points of a frame."""

    def __call__(self, motion: Motion) -> Tensor:
        """Points in the world, (*b, F, N, 3), metres."""

    def linearize(self, motion: Motion) -> Linearized:
        """Points, and their derivatives in the frame's tangent and in the shared blocks seen.

        The shared derivative has the blocks that the points see and the motion has, in the
        motion's order; it is None where there are none.
        """


@runtime_checkable
class OffersCurvature(Protocol):
    """Points with second derivatives in closed form."""

    def curvature(self, motion: Motion, linearized: Linearized, pull: Tensor) -> SecondOrder:
        """Second derivative of ``<pull, points>`` for a pull (*b, F, N, 3)."""


class Landmarks(nn.Module):
    """The landmarks of a skeleton as points, in the order of its rig; bones may be unknown.

    Args:
        skeleton: whose landmarks.
        last: how many of them, from the end; all if None.
    """

    sees: Collection[str] = (BONES,)

    def __init__(self, skeleton: Skeleton, last: int | None = None) -> None:
        super().__init__()
        self.skeleton = skeleton
        self.first = 0 if last is None else len(skeleton.rest_landmarks) - last

    @property
    def count(self) -> int:
        """All 16 of people, or the last ones."""
        return len(self.skeleton.rest_landmarks) - self.first

    def forward(self, motion: Motion) -> Tensor:
        """Landmarks in the world, (*b, F, N, 3), metres."""
        landmarks: Tensor = self.skeleton(motion).landmarks
        return landmarks[..., self.first :, :]

    def linearize(self, motion: Motion) -> Linearized:
        """In closed form; see ``Skeleton.linearize``."""
        points, frame, shared = self.skeleton.linearize(motion)
        if not self.first:
            return points, frame, shared
        kept = slice(self.first, None)
        own_shared = None if shared is None else shared[..., kept, :, :]
        return points[..., kept, :], frame[..., kept, :, :], own_shared

    def curvature(self, motion: Motion, linearized: Linearized, pull: Tensor) -> SecondOrder:
        """Second derivative of ``<pull, landmarks>`` for a pull (*b, F, N, 3)."""
        frame = linearized[1]
        if self.first:
            frame = self.skeleton.linearize(motion)[1]
            pull = torch.nn.functional.pad(pull, (0, 0, self.first, 0))
        return SecondOrder(*kinematic_curvature(self.skeleton, motion, frame, pull))
