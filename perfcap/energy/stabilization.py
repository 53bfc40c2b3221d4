"""Joints stay close to where they were before the silhouettes were looked at."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.energy._landmark_curvature import landmark_curvature
from perfcap.errors import InputError
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel
from perfcap.solve.second_order import SecondOrder


class Stabilization(Energy[Motion]):
    """Mean squared displacement of the joints from a reference (Xu et al. 2018, Eq. 12).

    A residual group is one joint: (joint - reference) / unit, 3 entries. The energy of a frame is
    ``weight`` times the mean over its joints.

    Args:
        actor: gives the joints.
        reference: where they were, (*b, F, 16, 3), metres.
        weight: of the mean; 0.06 in the paper.
        kernel: acts on the squared residual, in ``unit``.
        unit: metres that count as one, a number or (16,).

    Raises:
        InputError: the reference has other joints than the actor.
    """

    coupling = Coupling.FRAME
    sees_shared = True
    reference: Tensor
    scale: Tensor

    def __init__(
        self,
        actor: Actor,
        reference: Tensor,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float | Tensor = 1.0,
    ) -> None:
        count = len(actor.skeleton.rest_landmarks)
        if reference.shape[-2:] != (count, 3):
            raise InputError(
                f"reference has shape {tuple(reference.shape)}; give the actor's joints, "
                f"(*b, F, {count}, 3)"
            )
        super().__init__(weight / count, kernel)
        self.actor = actor
        self.register_buffer("reference", reference)
        self.register_buffer("scale", (1 / torch.as_tensor(unit).to(reference))[..., None])

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, 16, 3)."""
        return self._residual(self.actor.joints(motion))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form: joint derivatives in ``unit``."""
        joints, frame, shared = self.actor.skeleton.linearize(motion)
        scale = self.scale[..., None]
        return Linearization(
            self._residual(joints), scale * frame, None if shared is None else scale * shared
        )

    def second_order(self, motion: Motion, pull: Tensor) -> SecondOrder:
        """Closed form: that of the joints."""
        linearized = self.actor.skeleton.linearize(motion)
        return landmark_curvature(self.actor, motion, linearized, self.scale * pull)

    def _residual(self, joints: Tensor) -> Residual:
        return Residual(self.scale * (joints - self.reference))
