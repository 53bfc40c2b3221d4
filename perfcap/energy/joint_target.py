"""Distance between the joints and where an estimator puts them in space."""

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


class JointTarget(Energy[Motion]):
    """Confidence-weighted distance of the joints from places in the world; not in the paper.

    For estimators that say where a person is and not only in what pose. A residual group is one
    joint from one source: (joint - target) / unit, 3 entries. Sources are views, or several
    estimators.

    Args:
        actor: gives the joints.
        target: (*b, F, C, 16, 3), metres, in the world.
        confidence: (*b, F, C, 16).
        weight: of the energy.
        kernel: acts on the squared residual, in ``unit``.
        unit: metres that count as one, a number or (16,).

    Raises:
        InputError: shapes that do not fit each other or the actor.
    """

    coupling = Coupling.FRAME
    sees_shared = True
    target: Tensor
    confidence: Tensor
    scale: Tensor

    def __init__(
        self,
        actor: Actor,
        target: Tensor,
        confidence: Tensor,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float | Tensor = 1.0,
    ) -> None:
        count = len(actor.skeleton.rest_landmarks)
        if target.shape[-2:] != (count, 3) or confidence.shape != target.shape[:-1]:
            raise InputError(
                f"target has shape {tuple(target.shape)} and confidence {tuple(confidence.shape)}; "
                f"give (*b, F, C, {count}, 3) and (*b, F, C, {count})"
            )
        super().__init__(weight, kernel)
        self.actor = actor
        self.register_buffer("target", target)
        self.register_buffer("confidence", confidence)
        self.register_buffer("scale", (1 / torch.as_tensor(unit).to(target))[..., None])

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, C * 16, 3)."""
        return self._residual(self.actor.joints(motion))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form: joint derivatives in ``unit``, the same for every source."""
        joints, frame, shared = self.actor.skeleton.linearize(motion)
        rows = [None if part is None else self._repeated(part) for part in (frame, shared)]
        assert rows[0] is not None
        return Linearization(self._residual(joints), rows[0], rows[1])

    def second_order(self, motion: Motion, pull: Tensor) -> SecondOrder:
        """Closed form: that of the joints."""
        linearized = self.actor.skeleton.linearize(motion)
        on_joints = (self.scale * pull.reshape(*pull.shape[:-2], *self.target.shape[-3:])).sum(-3)
        return landmark_curvature(self.actor, motion, linearized, on_joints)

    def _residual(self, joints: Tensor) -> Residual:
        error = self.scale * (joints.unsqueeze(-3) - self.target)
        return Residual(error.flatten(-3, -2), self.confidence.flatten(-2))

    def _repeated(self, derivative: Tensor) -> Tensor:
        """Derivative (*b, F, C * 16, 3, D) from that of the joints, (*b, F, 16, 3, D)."""
        sources = self.target.shape[-3]
        scaled = (self.scale[..., None] * derivative).unsqueeze(-4)
        return scaled.expand(*scaled.shape[:-4], sources, *scaled.shape[-3:]).flatten(-4, -3)
