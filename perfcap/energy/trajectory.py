"""Smoothness of a window: what its trajectories have outside a low-frequency subspace."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.energy._arguments import require_scale
from perfcap.geometry.plain import is_plain
from perfcap.geometry.rotation import aligned, rotvec_to_quaternion
from perfcap.setting_checks import require_count
from perfcap.solve.energy import WindowEnergy
from perfcap.solve.second_order import SecondOrder
from perfcap.temporal.subspace import dct_basis


class Trajectory(WindowEnergy[Motion]):
    """Null-space projection of the pose parameters over a window (Xu et al. 2018, Eq. 7 and 8).

    The features of a frame are the root translation, the root rotation as **twice its unit
    quaternion**, with signs chosen so that neighbouring frames agree, and the angles; each is
    scaled by its published weight lambda. The chart of the root rotation matters: Euler angles
    and rotation vectors jump when a person turns around, and a prior on them then tears the
    window apart. A quaternion is a smooth function of time through any number of full turns, and
    twice the quaternion moves exactly as fast as the rotation (its derivative in the rotation
    has orthonormal columns), so the published weight in radians keeps its meaning.

    Args:
        frames: F, the length of the window.
        rank: K, the number of DCT vectors that stay free.
        weight: of the energy; the paper's 1 / |B| belongs in here.
        translation: lambda_t, per metre, a number or (*b, 1, 1) of each window.
        rotation: lambda_R, per radian, likewise.
        angles: lambda_Theta, per radian, a number, (A,) or (*b, 1, A).
        keep: (K',) how much of each DCT component is left unpenalised, a soft edge instead of
            the sharp one; overrides ``rank``.
    """

    translation: Tensor
    rotation: Tensor
    angles: Tensor

    def __init__(
        self,
        frames: int,
        rank: int = 8,
        weight: float | Tensor = 1.0,
        *,
        translation: float | Tensor = 1.0,
        rotation: float | Tensor = 1.0,
        angles: float | Tensor = 1.0,
        keep: Tensor | None = None,
    ) -> None:
        require_count(frames, "frames")
        require_count(rank, "rank")
        kept = torch.ones(min(rank, frames), dtype=torch.float64) if keep is None else keep
        super().__init__(dct_basis(frames, len(kept), dtype=kept.dtype), kept, weight)
        for name, scale in (
            ("translation", translation),
            ("rotation", rotation),
            ("angles", angles),
        ):
            require_scale(scale, name)
            self.register_buffer(name, torch.as_tensor(scale, dtype=kept.dtype))

    def features(self, motion: Motion) -> Tensor:
        """(*b, F, 3 + 4 + A)."""
        return self._features(motion)

    def _features(self, motion: Motion) -> Tensor:
        """Of a motion itself, whatever a subclass makes of them."""
        quaternion = aligned(rotvec_to_quaternion(motion.rotation))
        return torch.cat(
            (
                self.translation * motion.translation,
                2 * self.rotation * quaternion,
                self.angles * motion.angles,
            ),
            -1,
        )

    def linearize_features(self, motion: Motion) -> tuple[Tensor, Tensor]:
        """Features and their derivative (*b, F, 3 + 4 + A, 6 + A), block-diagonal."""
        scales = (self.translation, self.rotation, self.angles)
        if is_plain(motion.translation, motion.rotation, motion.angles) and is_plain(*scales):
            from perfcap.energy import _trajectory_numba

            return _trajectory_numba.linearize_features(scales, motion)
        features = self._features(motion)
        count = motion.angles.shape[-1]
        jacobian = features.new_zeros(*features.shape, 6 + count)
        moving = self.translation.to(features).expand(*motion.translation.shape)
        jacobian[..., :3, :3] = torch.diag_embed(moving)
        jacobian[..., 3:7, 3:6] = _quaternion_derivative(features[..., 3:7])
        jacobian[..., 7:, 6:] = torch.diag_embed(self.angles.to(features).expand_as(motion.angles))
        return features, jacobian

    def second_order(self, motion: Motion, pull: Tensor) -> SecondOrder:
        """Closed form: turning a quaternion q by a rotation vector d gives ``- q |d|^2 / 8``."""
        quaternion = 2 * self.rotation * aligned(rotvec_to_quaternion(motion.rotation))
        along = (pull[..., 3:7] * quaternion).sum(-1)
        diagonal = torch.zeros_like(motion.coordinates().frame)
        diagonal[..., 3:6] = -0.25 * along.unsqueeze(-1)
        return SecondOrder(torch.diag_embed(diagonal))


def _quaternion_derivative(quaternion: Tensor) -> Tensor:
    """Derivative (*b, 4, 3) of 2 q in a left rotation: columns (0, e_k) q, times the scale of q."""
    w, x, y, z = (0.5 * quaternion).unbind(-1)
    rows = (-x, -y, -z, w, z, -y, -z, w, x, y, -x, w)
    return torch.stack(rows, -1).reshape(*w.shape, 4, 3)


# --------------------------------------------------------------------------------------------------
# Changes to a motion that is good already are slow; the motion itself may be as fast as it is.

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
        self.register_buffer("given", self._features(given))

    def features(self, motion: Motion) -> Tensor:
        """(*b, F, 3 + 4 + A)."""
        features = self._features(motion)
        return features * self._sign(features) - self.given

    def linearize_features(self, motion: Motion) -> tuple[Tensor, Tensor]:
        """Features and their derivative (*b, F, 3 + 4 + A, 6 + A), block-diagonal."""
        features, jacobian = super().linearize_features(motion)
        sign = self._sign(features)
        return features * sign - self.given, jacobian * sign.unsqueeze(-1)

    def second_order(self, motion: Motion, pull: Tensor) -> SecondOrder:
        """Closed form; see ``Trajectory``."""
        return super().second_order(motion, pull * self._sign(self._features(motion)))

    def _sign(self, features: Tensor) -> Tensor:
        """-1 for the quaternions of windows whose hemisphere is not that of the given motion's."""
        first = slice(0, 1)
        cosine = (features[..., first, _ROTATION] * self.given[..., first, _ROTATION]).sum(
            -1, keepdim=True
        )
        sign = torch.ones_like(features[..., first, :])
        sign[..., _ROTATION] = torch.where(cosine < 0, -1.0, 1.0).to(sign)
        return sign
