"""Warps of graph nodes over frames: the unknowns of surface refinement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from perfcap.geometry.rotation import compose_rotvec
from perfcap.solve.energy import Step

BLOCK = 6  # unknowns of a node: rotation, translation


@dataclass(frozen=True)
class Deformation:
    """Rotation and translation of every node of a deformation graph over frames (Xu 2018, Eq. 14).

    The tangent vector of a frame is node after node, (rotation, translation) each. Rotations move
    by ``R <- exp(step) R``, a left perturbation in world axes; the rotation *vector* is storage.

    Attributes:
        rotation: of each node about its canonical position, (*b, F, M, 3), rotation vector in
            world axes, radians.
        translation: of each node, (*b, F, M, 3), world axes, metres.
    """

    rotation: Tensor
    translation: Tensor

    def __post_init__(self) -> None:
        rotation, translation = tuple(self.rotation.shape), tuple(self.translation.shape)
        if rotation != translation or len(rotation) < 3 or rotation[-1] != 3:
            raise ValueError(
                f"deformation has rotation {rotation} and translation {translation}, expected "
                "(*b, F, M, 3) both"
            )

    @classmethod
    def identity(cls, lead: Sequence[int], nodes: int, like: Tensor) -> Self:
        """No deformation: lead (*b, F), M nodes, with the type and device of a tensor."""
        zero = like.new_zeros(*lead, nodes, 3)
        return cls(zero, zero)

    @property
    def block_dim(self) -> int:
        """Unknowns of a node, 6."""
        return BLOCK

    @property
    def frame_dim(self) -> int:
        """D = 6 M."""
        return BLOCK * self.nodes

    @property
    def shared_sizes(self) -> dict[str, int]:
        """Empty: no unknown is shared by frames."""
        return {}

    @property
    def frames(self) -> int:
        """F."""
        return self.rotation.shape[-3]

    @property
    def nodes(self) -> int:
        """M."""
        return self.rotation.shape[-2]

    def retract(self, step: Step) -> Self:
        """Move along a tangent vector."""
        blocks = step.frame.reshape(*step.frame.shape[:-1], self.nodes, BLOCK)
        rotation, translation = blocks[..., :3], blocks[..., 3:]
        return replace(
            self,
            rotation=compose_rotvec(rotation, self.rotation),
            translation=self.translation + translation,
        )

    def local(self, other: Self) -> Step:
        """Tangent vector from here to another deformation of the same shape."""
        turn = compose_rotvec(other.rotation, -self.rotation)
        return self._step(turn, other.translation - self.translation)

    def coordinates(self) -> Step:
        """Numbers that bounds apply to: only translations may be bounded."""
        return self._step(self.rotation, self.translation)

    def _step(self, rotation: Tensor, translation: Tensor) -> Step:
        frame = torch.cat((rotation, translation), -1).flatten(-2)
        return Step(frame, frame.new_zeros(*frame.shape[:-2], 0))

    def __getitem__(self, index: slice | Tensor) -> Self:
        """Select along the frame axis."""
        return replace(
            self,
            rotation=self.rotation[..., index, :, :],
            translation=self.translation[..., index, :, :],
        )

    def to(self, like: Tensor) -> Self:
        """The same deformation with the type and device of a tensor."""
        return replace(self, rotation=self.rotation.to(like), translation=self.translation.to(like))
