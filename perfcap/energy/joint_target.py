"""Distance between joints and places in space, where an estimator or an earlier stage put them."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import PointDifferences, Points
from perfcap.energy._arguments import (
    known_places,
    require_confidence,
    require_metres,
    require_places,
    require_unit,
    seen_by,
)
from perfcap.energy._point_curvature import point_curvature
from perfcap.errors import InputError
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel
from perfcap.solve.second_order import SecondOrder


class JointTarget(Energy[Motion]):
    """Confidence-weighted distance of joints from places in the world.

    A residual group is one joint from one source: (joint - target) / unit, 3 entries. Sources are
    views, or several estimators that say where a person is and not only in what pose. With one
    source, where the joints were before the silhouettes were looked at, and a weight of
    ``w_stab / N``, it is the stabilization of Xu et al. 2018, Eq. 12, a mean over the joints.

    Args:
        points: N joints, such as ``actor.landmarks``.
        target: (*b, F, C, N, 3), metres, in the world; anything where the confidence is 0.
        confidence: (*b, F, C, N); 1 if not given.
        weight: of the energy.
        kernel: acts on the squared residual, in ``unit``.
        unit: metres that count as one, a number or (N,).

    Raises:
        InputError: shapes that do not fit each other or the points, another unit than metres, or
            several points of a frame at 0, 0, 0.
    """

    coupling = Coupling.FRAME
    target: Tensor
    confidence: Tensor
    scale: Tensor

    def __init__(
        self,
        points: Points,
        target: Tensor,
        confidence: Tensor | None = None,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float | Tensor = 1.0,
    ) -> None:
        require_unit(unit)
        sees = seen_by(points)
        count = points.count
        if confidence is None:
            confidence = torch.ones_like(target[..., 0])
        fits = target.dim() > 3 and target.shape[-2:] == (count, 3)
        if not fits or confidence.shape != target.shape[:-1]:
            raise InputError(
                f"target has shape {tuple(target.shape)} and confidence {tuple(confidence.shape)}; "
                f"give (*b, F, C, {count}, 3) and (*b, F, C, {count})"
            )
        require_confidence(confidence)
        if not isinstance(points, PointDifferences):  # which may start at the world's origin
            require_metres(target, confidence)
            require_places(target, confidence)
        target = known_places(target, confidence, "target")
        super().__init__(weight, kernel)
        self.points, self.sees = points, sees
        self.register_buffer("target", target)
        self.register_buffer("confidence", confidence)
        self.register_buffer("scale", (1 / torch.as_tensor(unit).to(target))[..., None])

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, C * N, 3)."""
        return self._residual(self.points(motion))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form: joint derivatives in ``unit``, the same for every source."""
        joints, frame, shared = self.points.linearize(motion)
        rows = [None if part is None else self._repeated(part) for part in (frame, shared)]
        assert rows[0] is not None
        return Linearization(self._residual(joints), rows[0], rows[1])

    def second_order(self, motion: Motion, pull: Tensor) -> SecondOrder:
        """Closed form: that of the joints."""
        linearized = self.points.linearize(motion)
        on_joints = (self.scale * pull.reshape(*pull.shape[:-2], *self.target.shape[-3:])).sum(-3)
        return point_curvature(self.points, motion, linearized, on_joints)

    def _residual(self, joints: Tensor) -> Residual:
        if joints.shape[-3] != self.target.shape[-4]:
            raise InputError(
                f"target has shape {tuple(self.target.shape)}, so frames "
                f"{self.target.shape[-4]}, but the motion has {joints.shape[-3]} frames; expected "
                "(*b, F, C, N, 3) with a place for each frame and source"
            )
        error = self.scale * (joints.unsqueeze(-3) - self.target)
        return Residual(error.flatten(-3, -2), self.confidence.flatten(-2))

    def _repeated(self, derivative: Tensor) -> Tensor:
        """Derivative (*b, F, C * N, 3, D) from that of the joints, (*b, F, N, 3, D)."""
        sources = self.target.shape[-3]
        scaled = (self.scale[..., None] * derivative).unsqueeze(-4)
        return scaled.expand(*scaled.shape[:-4], sources, *scaled.shape[-3:]).flatten(-4, -3)
