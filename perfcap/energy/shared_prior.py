"""A Gaussian on unknowns that all frames share: shapes, clocks, cameras."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import BODY, Motion
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual


class SharedPrior(Energy[Motion]):
    """Gaussian on a shared block: sum (value / deviation)^2, however many the frames.

    Args:
        components: S of the block.
        frames: F.
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
        self.sees, self.block, self.components = (block,), block, components
        spread = torch.as_tensor(deviation, dtype=torch.float64).expand(components)
        self.register_buffer("scale", 1 / (spread * frames**0.5))

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, S, 1), equal in all frames."""
        if self.block not in motion.shared:
            raise ValueError(f"SharedPrior needs a motion that shares {self.block}; it does not")
        own = motion.shared[self.block]
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
