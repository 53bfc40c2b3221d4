"""Poses over frames: the unknowns of motion capture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeVar

import torch
from torch import Tensor

from perfcap.geometry.rotation import compose_rotvec
from perfcap.solve.energy import Step

_T = TypeVar("_T")


@dataclass(frozen=True)
class Motion:
    """Root position and rotation, joint angles and (optionally) bone lengths over frames.

    The tangent vector of a frame is (translation, rotation, angles). Rotations move by
    ``R <- exp(step) R``, a left perturbation in world axes, so no chart is ever left and full
    turns are ordinary; the rotation *vector* is storage, not a chart anything is smoothed in.

    Attributes:
        translation: position of the root joint in the world, (*b, F, 3), metres.
        rotation: world rotation of the root relative to the rest pose, (*b, F, 3), rotation vector.
        angles: joint angles from the anatomical neutral pose, (*b, F, A), radians.
        shape: log scales of the bone groups, (*b, S), shared by all frames; None where bone
            lengths are known.
    """

    translation: Tensor
    rotation: Tensor
    angles: Tensor
    shape: Tensor | None = None
    _known: dict[object, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        lead = self.angles.shape[:-1]
        for name in ("translation", "rotation"):
            found = tuple(getattr(self, name).shape)
            if found != (*lead, 3):
                raise ValueError(f"motion {name} has shape {found}, expected {(*lead, 3)}")

    @property
    def frame_dim(self) -> int:
        """D = 6 + A."""
        return 6 + self.angles.shape[-1]

    @property
    def shared_dim(self) -> int:
        """S, 0 where bone lengths are not unknowns."""
        return 0 if self.shape is None else self.shape.shape[-1]

    @property
    def frames(self) -> int:
        """F."""
        return self.angles.shape[-2]

    def once(self, key: object, compute: Callable[[], _T]) -> _T:
        """What follows from this motion and ``key`` alone: computed when first asked for.

        Several energies want the same kinematics. The motion keeps the result as long as it
        lives; motions made from it start anew.
        """
        if key not in self._known:
            self._known[key] = compute()
        result: _T = self._known[key]
        return result

    def retract(self, step: Step) -> Self:
        """Move along a tangent vector."""
        translation, rotation, angles = step.frame.tensor_split((3, 6), -1)
        return replace(
            self,
            translation=self.translation + translation,
            rotation=compose_rotvec(rotation, self.rotation),
            angles=self.angles + angles,
            shape=None if self.shape is None else self.shape + step.shared,
        )

    def local(self, other: Self) -> Step:
        """Tangent vector from here to another motion of the same shape."""
        parts = (
            other.translation - self.translation,
            compose_rotvec(other.rotation, -self.rotation),
            other.angles - self.angles,
        )
        if self.shape is None or other.shape is None:
            shared = self.angles.new_zeros(*self.angles.shape[:-2], 0)
        else:
            shared = other.shape - self.shape
        return Step(torch.cat(parts, -1), shared)

    def coordinates(self) -> Step:
        """Numbers that bounds apply to: only angles and shape may be bounded."""
        shared = self.angles.new_zeros(*self.angles.shape[:-2], 0)
        return Step(
            torch.cat((self.translation, self.rotation, self.angles), -1),
            shared if self.shape is None else self.shape,
        )

    def __getitem__(self, index: slice | Tensor) -> Self:
        """Select along the frame axis."""
        return replace(
            self,
            translation=self.translation[..., index, :],
            rotation=self.rotation[..., index, :],
            angles=self.angles[..., index, :],
        )

    def to(self, like: Tensor) -> Self:
        """The same motion with the type and device of a tensor."""
        return replace(
            self,
            translation=self.translation.to(like),
            rotation=self.rotation.to(like),
            angles=self.angles.to(like),
            shape=None if self.shape is None else self.shape.to(like),
        )
