"""Poses over frames, and what all frames share: the unknowns of motion capture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeVar

import torch
from torch import Tensor

from perfcap.geometry.record import Record
from perfcap.geometry.rotation import compose_rotvec
from perfcap.solve.energy import Step

_T = TypeVar("_T")
BONES = "bones"  # shared log scales of a skeleton's bone groups
BODY = "body"  # shared coefficients of a body model


@dataclass(frozen=True)
class Motion(Record):
    """Root position and rotation and joint angles over frames, and unknowns that frames share.

    The tangent vector of a frame is (translation, rotation, angles). Rotations move by
    ``R <- exp(step) R``, a left perturbation in world axes, so no chart is ever left and full
    turns are ordinary; the rotation *vector* is storage, not a chart anything is smoothed in.

    Attributes:
        translation: position of the root joint in the world, (*b, F, 3), metres.
        rotation: world rotation of the root relative to the rest pose, (*b, F, 3), rotation vector.
        angles: joint angles from the anatomical neutral pose, (*b, F, A), radians.
        shared: named blocks of unknowns that all frames share, each (*b, n), in their order: log
            scales of the bone groups as ``"bones"``, coefficients of a body model as ``"body"``,
            and whatever else energies name. Empty where nothing but poses is sought.
    """

    translation: Tensor
    rotation: Tensor
    angles: Tensor
    shared: Mapping[str, Tensor] = field(default_factory=dict)
    _known: dict[object, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        lead = self.angles.shape[:-1]
        for name in ("translation", "rotation"):
            found = tuple(getattr(self, name).shape)
            if found != (*lead, 3):
                raise ValueError(f"motion {name} has shape {found}, expected {(*lead, 3)}")

    curved = slice(3, 6)  # of the coordinates: a rotation vector, which steps do not add to

    @property
    def frame_dim(self) -> int:
        """D = 6 + A."""
        return 6 + self.angles.shape[-1]

    @property
    def shared_sizes(self) -> dict[str, int]:
        """Unknowns of each shared block, in their order."""
        return {name: block.shape[-1] for name, block in self.shared.items()}

    @property
    def frames(self) -> int:
        """F."""
        return self.angles.shape[-2]

    def once(self, key: object, compute: Callable[[], _T]) -> _T:
        """What follows from this motion and ``key`` alone: computed when first asked for.

        Several energies want the same kinematics. The motion keeps the result as long as it
        lives and neither is changed in place; motions made from it start anew.
        """
        own = self.translation, self.rotation, self.angles, *self.shared.values()
        if key in self._known:
            result, stamp = self._known[key]
            if stamp == _stamp(*own, result):
                return result  # type: ignore[no-any-return]
        fresh = compute()
        self._known[key] = fresh, _stamp(*own, fresh)
        return fresh

    def retract(self, step: Step) -> Self:
        """Move along a tangent vector."""
        translation, rotation, angles = step.frame.tensor_split((3, 6), -1)
        steps = (
            torch.split(step.shared, list(self.shared_sizes.values()), -1) if self.shared else ()
        )
        return replace(
            self,
            translation=self.translation + translation,
            rotation=compose_rotvec(rotation, self.rotation),
            angles=self.angles + angles,
            shared={
                name: block + moved
                for (name, block), moved in zip(self.shared.items(), steps, strict=True)
            },
        )

    def local(self, other: Self) -> Step:
        """Tangent vector from here to another motion of the same shape."""
        parts = (
            other.translation - self.translation,
            compose_rotvec(other.rotation, -self.rotation),
            other.angles - self.angles,
        )
        return Step(torch.cat(parts, -1), other._shared_row() - self._shared_row())

    def coordinates(self) -> Step:
        """Numbers that bounds apply to: only angles and shared unknowns may be bounded."""
        frame = torch.cat((self.translation, self.rotation, self.angles), -1)
        return Step(frame, self._shared_row())

    def _shared_row(self) -> Tensor:
        """All that is shared, (*b, S)."""
        none = self.angles.new_zeros(*self.angles.shape[:-2], 0)
        return torch.cat((none, *self.shared.values()), -1) if self.shared else none

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
        return self.map(lambda each: each.to(like))


def _stamp(*values: object) -> tuple[int, ...]:
    """How often tensors, or those of tuples, were changed in place; 0 for inference tensors."""
    found: list[int] = []
    for value in values:
        if isinstance(value, tuple):
            found += _stamp(*value)
        elif isinstance(value, Tensor):
            found.append(0 if value.is_inference() else value._version)
    return tuple(found)
