"""Weak preferences for poses and bone lengths, where images say nothing."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import BONES, Motion
from perfcap.geometry.plain import is_plain
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual


class PosePrior(Energy[Motion]):
    """Gaussian on the joint angles: sum ((angle - mean) / deviation)^2 (MuVS Eq. 2, diagonal).

    Twists of straight limbs and of the head leave the landmarks where they are; this keeps them
    at rest instead of wherever the solver strayed. Beyond what is ``usual`` it is steeper: there
    the residual grows by ``1 / beyond`` a radian more.

    Args:
        mean: (A,), radians.
        deviation: (A,) or a number, radians.
        weight: of the energy.
        usual: lower and upper ends of the usual ranges, (A,) each, radians, around the mean;
            the whole line when not given.
        beyond: deviation outside of them, radians.
    """

    coupling = Coupling.FRAME
    mean: Tensor
    scale: Tensor
    lower: Tensor
    upper: Tensor
    steeper: Tensor

    def __init__(
        self,
        mean: Tensor,
        deviation: float | Tensor = 1.0,
        weight: float | Tensor = 1.0,
        usual: tuple[Tensor, Tensor] | None = None,
        beyond: float = torch.inf,
    ) -> None:
        super().__init__(weight)
        free = torch.full_like(mean, torch.inf)
        lower, upper = (-free, free) if usual is None else (each.to(mean) for each in usual)
        self.register_buffer("mean", mean)
        self.register_buffer("scale", 1 / torch.as_tensor(deviation).to(mean).expand_as(mean))
        self.register_buffer("lower", lower)
        self.register_buffer("upper", upper)
        self.register_buffer("steeper", mean.new_tensor(1 / beyond))

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, A, 1)."""
        return Residual(self._rows(motion.angles).unsqueeze(-1))

    def linearize(self, motion: Motion) -> Linearization:
        """A diagonal."""
        residual = self.residual(motion)
        jacobian = torch.nn.functional.pad(self._slopes(motion.angles).diag_embed(), (6, 0))
        return Linearization(residual, jacobian.unsqueeze(-2))

    def _rows(self, angles: Tensor) -> Tensor:
        outside = angles - angles.clamp(self.lower, self.upper)
        return self.scale * (angles - self.mean) + self.steeper * outside

    def _slopes(self, angles: Tensor) -> Tensor:
        outside = (angles < self.lower) | (angles > self.upper)
        return self.scale + self.steeper * outside

    def add_to_blocks(self, motion: Motion, curvature: Tensor, gradient: Tensor) -> Tensor | None:
        """A number on the diagonal; see ``OffersBlocks``."""
        plain = is_plain(curvature, gradient, motion.angles, self.mean, self.scale)
        if self.weight.ndim or not (plain and is_plain(self.weight)):
            return None
        angles = motion.angles.reshape(*gradient.shape[:-1], -1)
        error, slope = self._rows(angles), self._slopes(angles)
        weighted = self.weight.to(error) * slope
        gradient[..., 6:] += weighted * error
        curvature.diagonal(dim1=-2, dim2=-1)[..., 6:] += weighted * slope
        return self.weight.to(error) * error.square().sum((-2, -1))

    def second_order(self, motion: Motion, pull: Tensor) -> None:
        """None: the residual is linear, but at the ends of usual ranges."""


class BoneLengthPrior(Energy[Motion]):
    """Gaussian on the log bone lengths: a person of another size with similar proportions.

    ``bones_g = size + own_g`` with deviations ``size`` and ``own``; the size is integrated out.

    Args:
        groups: S, the number of bone groups.
        frames: F; the prior acts once, however many frames share the bones.
        size: deviation of the log size of people.
        own: deviation of a single bone's log length at a given size.
        weight: of the energy.
    """

    coupling = Coupling.FRAME
    sees = (BONES,)
    whiten: Tensor

    def __init__(
        self,
        groups: int,
        frames: int,
        size: float = 0.08,
        own: float = 0.06,
        weight: float | Tensor = 1.0,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        super().__init__(weight)
        covariance = own**2 * torch.eye(groups, dtype=dtype) + size**2
        whiten = torch.linalg.inv(torch.linalg.cholesky(covariance))
        self.register_buffer("whiten", whiten / frames**0.5)

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, S, 1), equal in all frames."""
        if BONES not in motion.shared:
            raise ValueError("BoneLengthPrior needs a motion that shares bones; it does not")
        white = motion.shared[BONES] @ self.whiten.mT
        frames = motion.angles.shape[-2]
        return Residual(white[..., None, :, None].expand(*white.shape[:-1], frames, -1, 1))

    def linearize(self, motion: Motion) -> Linearization:
        """A constant matrix in the shared block."""
        residual = self.residual(motion)
        lead = residual.value.shape[:-2]
        frame = residual.value.new_zeros(1).expand(*lead, len(self.whiten), 1, motion.frame_dim)
        shared = self.whiten[:, None].expand(*lead, len(self.whiten), 1, len(self.whiten))
        return Linearization(residual, frame, shared)

    def second_order(self, motion: Motion, pull: Tensor) -> None:
        """None: the residual is linear."""
