"""Changes to a motion that is good already are slow; the motion itself may be as fast as it is."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.energy.trajectory import Trajectory
from perfcap.solve.second_order import SecondOrder

_ROTATION = slice(3, 7)


class TrajectoryChange(Trajectory):
    """What the difference to a given motion has outside a low-frequency subspace.

    Retargeting as spacetime constraints (Gleicher 1998, Sec. 4.2): high frequencies of a recorded
    motion are what makes it one, those of a correction are pops. The features are those of
    ``Trajectory`` minus the given motion's.

    Args:
        given: the motion, (*b, F).
        keep: (K,) how much of each DCT component of the change is left unpenalised.
        weight: of the energy.
        translation: per metre.
        rotation: per radian.
        angles: per radian.
    """

    given: Tensor

    def __init__(
        self,
        given: Motion,
        keep: Tensor,
        weight: float | Tensor = 1.0,
        *,
        translation: float = 1.0,
        rotation: float = 1.0,
        angles: float = 1.0,
    ) -> None:
        super().__init__(
            given.frames,
            weight=weight,
            translation=translation,
            rotation=rotation,
            angles=angles,
            keep=keep,
        )
        self.register_buffer("given", super().features(given))

    def features(self, motion: Motion) -> Tensor:
        """(*b, F, 3 + 4 + A)."""
        features = super().features(motion)
        return features * self._sign(features) - self.given

    def linearize_features(self, motion: Motion) -> tuple[Tensor, Tensor]:
        """Features and their derivative (*b, F, 3 + 4 + A, 6 + A), block-diagonal."""
        features, jacobian = super().linearize_features(motion)
        sign = self._sign(features)
        return features * sign - self.given, jacobian * sign.unsqueeze(-1)

    def second_order(self, motion: Motion, pull: Tensor) -> SecondOrder:
        """Closed form; see ``Trajectory``."""
        return super().second_order(motion, pull * self._sign(super().features(motion)))

    def _sign(self, features: Tensor) -> Tensor:
        """-1 for the quaternions of windows whose hemisphere is not that of the given motion's."""
        first = slice(0, 1)
        cosine = (features[..., first, _ROTATION] * self.given[..., first, _ROTATION]).sum(
            -1, keepdim=True
        )
        sign = torch.ones_like(features[..., first, :])
        sign[..., _ROTATION] = torch.where(cosine < 0, -1.0, 1.0).to(sign)
        return sign
