"""Unit dual quaternions: rigid motions that blend without losing volume (Kavan et al. 2007).

A motion "rotate by q, then move by t" is ``q + eps (t q) / 2`` with eps^2 = 0 and t read as the
quaternion (0, t). Quaternions are (w, x, y, z); (r, d) and (-r, -d) are the same motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from perfcap.geometry.rotation import (
    matrix_to_quaternion,
    quaternion_multiply,
    quaternion_to_matrix,
)


@dataclass(frozen=True)
class DualQuaternion:
    """Rigid motions as unit dual quaternions.

    Attributes:
        real: (*b, 4), unit length: the rotation.
        dual: (*b, 4), at right angles to ``real``; carries the translation, metres.
    """

    real: Tensor
    dual: Tensor

    @classmethod
    def from_rigid(cls, rotation: Tensor, translation: Tensor) -> Self:
        """From rotation matrices (*b, 3, 3) and translations (*b, 3), metres."""
        return cls.from_quaternion(matrix_to_quaternion(rotation), translation)

    @classmethod
    def from_quaternion(cls, quaternion: Tensor, translation: Tensor) -> Self:
        """From unit quaternions (*b, 4) and translations (*b, 3), metres."""
        return cls(quaternion, 0.5 * quaternion_multiply(_pure(translation), quaternion))

    def to_rigid(self) -> tuple[Tensor, Tensor]:
        """Rotation matrices (*b, 3, 3) and translations (*b, 3), metres."""
        return quaternion_to_matrix(self.real), self.translation

    @property
    def translation(self) -> Tensor:
        """Translations (*b, 3), metres."""
        return 2 * quaternion_multiply(self.dual, _conjugate(self.real))[..., 1:]

    def multiply(self, other: DualQuaternion) -> DualQuaternion:
        """The motion ``other``, then this one."""
        crossed = quaternion_multiply(self.real, other.dual)
        crossed = crossed + quaternion_multiply(self.dual, other.real)
        return DualQuaternion(quaternion_multiply(self.real, other.real), crossed)

    def inverse(self) -> DualQuaternion:
        """The motion back."""
        return DualQuaternion(_conjugate(self.real), _conjugate(self.dual))

    def apply(self, points: Tensor) -> Tensor:
        """Move points (*b, N, 3), metres."""
        rotation, translation = self.to_rigid()
        return points @ rotation.mT + translation.unsqueeze(-2)

    def normalized(self) -> DualQuaternion:
        """The unit dual quaternion in this direction; ``real`` must not vanish.

        The dual part keeps what ``real`` would add to it. It does not matter to the motion as
        this class reads it, but makes products of normalised values exact.
        """
        length = self.real.norm(dim=-1, keepdim=True)
        real, dual = self.real / length, self.dual / length
        return DualQuaternion(real, dual - (real * dual).sum(-1, keepdim=True) * real)

    def blend(self, weights: Tensor) -> DualQuaternion:
        """Dual quaternion linear blend (DLB) over the last batch axis.

        Signs are flipped to agree with the motion of largest weight, so the result does not
        depend on them, and its real part cannot vanish.

        Args:
            weights: (*b, K) for motions (*b, K), not negative, not all zero.

        Returns:
            Motions (*b).
        """
        largest = weights.argmax(-1, keepdim=True).unsqueeze(-1)
        pivot = self.real.gather(-2, largest.expand(*largest.shape[:-1], 4))
        signed = weights * sign_to(pivot, self.real)
        real = (signed.unsqueeze(-1) * self.real).sum(-2)
        dual = (signed.unsqueeze(-1) * self.dual).sum(-2)
        return DualQuaternion(real, dual).normalized()


def sign_to(reference: Tensor, quaternion: Tensor) -> Tensor:
    """Sign (*b), one or minus one, that brings quaternions (*b, 4) to the side of a reference."""
    agreement = (reference * quaternion).sum(-1)
    return torch.where(agreement < 0, -1.0, 1.0).to(quaternion.dtype)


def _pure(vector: Tensor) -> Tensor:
    return torch.cat((torch.zeros_like(vector[..., :1]), vector), -1)


def _conjugate(quaternion: Tensor) -> Tensor:
    return torch.cat((quaternion[..., :1], -quaternion[..., 1:]), -1)
