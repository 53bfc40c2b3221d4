"""Weak preferences for poses, bone lengths and shared unknowns, where images say nothing."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import BODY, BONES, Motion
from perfcap.actor.pose_statistics import Mixture
from perfcap.energy._arguments import require_frames, require_radians, require_unit
from perfcap.errors import InputError
from perfcap.geometry.plain import is_plain, is_readable
from perfcap.setting_checks import require_count, require_number, require_size
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
        require_unit(deviation, "deviation")
        require_unit(beyond, "beyond")
        free = torch.full_like(mean, torch.inf)
        lower, upper = (-free, free) if usual is None else (each.to(mean) for each in usual)
        for name, angles in (("mean", mean), ("usual", lower), ("usual", upper)):
            require_radians(angles, name)
        if is_readable(lower) and is_readable(upper) and not bool((lower <= upper).all()):
            raise InputError("usual: a lower end is above its upper end; expected radians")
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
        require_count(groups, "groups")
        require_count(frames, "frames")
        require_number(size, "size", least=0)
        require_size(own, "own", finite=True)
        covariance = own**2 * torch.eye(groups, dtype=dtype) + size**2
        whiten = torch.linalg.inv(torch.linalg.cholesky(covariance))
        self.frames = frames
        self.register_buffer("whiten", whiten / frames**0.5)

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, S, 1), equal in all frames."""
        if BONES not in motion.shared:
            raise ValueError("BoneLengthPrior needs a motion that shares bones; it does not")
        frames, own = motion.angles.shape[-2], motion.shared[BONES]
        require_frames(self, self.frames, frames)
        _require_size(self, len(self.whiten), own)
        white = own @ self.whiten.mT
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


# --- A Gaussian on unknowns that all frames share: shapes, clocks, cameras ------------------------


class SharedPrior(Energy[Motion]):
    """Gaussian on a shared block: sum (value / deviation)^2, however many the frames.

    Args:
        components: S of the block.
        frames: F of the motion.
        deviation: of every value, a number or (S,).
        weight: of the energy.
        block: name of the block.
    """

    coupling = Coupling.FRAME
    scale: Tensor

    def __init__(
        self,
        components: int,
        frames: int = 1,
        deviation: float | Tensor = 1.0,
        weight: float | Tensor = 1.0,
        block: str = BODY,
    ) -> None:
        super().__init__(weight)
        require_count(components, "components")
        require_count(frames, "frames")
        require_unit(deviation, "deviation")
        self.sees, self.block, self.components = (block,), block, components
        self.frames = frames
        spread = torch.as_tensor(deviation, dtype=torch.float64).expand(components)
        self.register_buffer("scale", 1 / (spread * frames**0.5))

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, S, 1), equal in all frames."""
        if self.block not in motion.shared:
            raise ValueError(f"SharedPrior needs a motion that shares {self.block}; it does not")
        own = motion.shared[self.block]
        require_frames(self, self.frames, motion.angles.shape[-2])
        _require_size(self, self.components, own)
        value = (self.scale.to(own) * own)[..., None, :, None]
        lead = motion.angles.shape[:-1]
        return Residual(value.expand(*lead, self.components, 1))

    def linearize(self, motion: Motion) -> Linearization:
        """A constant diagonal in the shared block."""
        residual = self.residual(motion)
        lead = motion.angles.shape[:-1]
        frame = residual.value.new_zeros(1).expand(*lead, self.components, 1, motion.frame_dim)
        shared = self.scale.to(residual.value).diag()[:, None]
        return Linearization(residual, frame, shared.expand(*lead, *shared.shape))


def _require_size(energy: object, size: int, block: Tensor) -> None:
    if block.shape[-1] != size:
        raise InputError(
            f"{type(energy).__name__} is made for {size} numbers but the motion shares "
            f"{block.shape[-1]}; make one for as many"
        )


# --- Poses that people take: a mixture of Gaussians over the joint angles (MuVS Eq. 2) ------------


class PoseMixture(Energy[Motion]):
    """Twice the negative log density of the likeliest component (Bogo et al. 2016, Eq. 7).

    ``min_k |L_k' (angles - mean_k)|^2 + c_k``: one group of A + 1 entries a frame, of the
    component that is least; the last entry is the root of c_k >= 0.

    Args:
        mixture: over the angles of the motion, in their order.
        weight: of the energy.
    """

    coupling = Coupling.FRAME
    mean: Tensor
    factor: Tensor
    constant: Tensor

    def __init__(self, mixture: Mixture, weight: float | Tensor = 1.0) -> None:
        super().__init__(weight)
        self.register_buffer("mean", mixture.mean)
        self.register_buffer("factor", mixture.precision)
        self.register_buffer("constant", mixture.surprise.clamp(min=0).sqrt())

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, 1, A + 1)."""
        return self._chosen(motion)[0]

    def linearize(self, motion: Motion) -> Linearization:
        """The transposed factor of the chosen component."""
        residual, index = self._chosen(motion)
        rows = self.factor.to(motion.angles).mT[index]  # *b F A A
        rows = torch.nn.functional.pad(rows, (6, 0, 0, 1))
        return Linearization(residual, rows.unsqueeze(-3))

    def second_order(self, motion: Motion, pull: Tensor) -> None:
        """None: the residual is linear within a component."""

    def _chosen(self, motion: Motion) -> tuple[Residual, Tensor]:
        """Rows, and which component they are of, (*b, F)."""
        angles = motion.angles
        mean, factor, constant = (x.to(angles) for x in (self.mean, self.factor, self.constant))
        white = torch.einsum("kba,...kb->...ka", factor, angles.unsqueeze(-2) - mean)
        index = (white.square().sum(-1) + constant.square()).argmin(-1)
        picked = index[..., None, None].expand(*index.shape, 1, white.shape[-1])
        row = torch.cat((white.gather(-2, picked), constant[index][..., None, None]), -1)
        return Residual(row), index
