"""Feet stay above the floor."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import Points
from perfcap.energy._arguments import require_confidence, require_unit, seen_by
from perfcap.energy._point_curvature import point_curvature
from perfcap.errors import InputError
from perfcap.geometry.plain import is_readable
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel
from perfcap.solve.second_order import SecondOrder


class FloorPenetration(Energy[Motion]):
    """Points do not sink into the floor; not in the papers.

    ``sum_f sum_k min(0, n . x_k(f) - h)^2 / unit^2`` for a floor ``n . x = h``: one-sided and
    soft. Its derivative is continuous, zero on the floor and above it. A residual group is one
    point, 1 entry.

    Args:
        points: N, such as those under the feet.
        normal: of the floor, a unit vector that points up, (3,), or one a window, (*b, 3).
        height: of the floor along the normal, metres, a number or (*b,).
        confidence: of the points, (*b, F, N), such as 0 in frames in which there is no floor.
        weight: of the energy.
        kernel: acts on the squared residual, in ``unit``.
        unit: metres that count as one.

    Raises:
        InputError: a normal that is no unit vector, or confidences that are none.
    """

    coupling = Coupling.FRAME
    normal: Tensor
    height: Tensor
    confidence: Tensor

    def __init__(
        self,
        points: Points,
        normal: Tensor,
        height: Tensor | float,
        confidence: Tensor,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float = 1.0,
    ) -> None:
        require_unit(unit)
        sees = seen_by(points)
        if normal.shape[-1:] != (3,) or not bool(((normal.norm(dim=-1) - 1).abs() < 1e-4).all()):
            raise InputError(
                f"normal is {normal.tolist()}; expected unit vectors (*b, 3); divide by the norm"
            )
        if confidence.shape[-1:] != (points.count,):
            raise InputError(
                f"confidence has shape {tuple(confidence.shape)}; give (*b, F, {points.count}), "
                "one for each point"
            )
        require_confidence(confidence)
        level = torch.as_tensor(height).to(normal)
        if is_readable(level) and not bool(level.isfinite().all()):
            raise InputError(f"height is {height}; expected finite metres along the normal")
        super().__init__(weight, kernel)
        self.points, self.sees = points, sees
        self.scale = 1 / unit
        self.register_buffer("normal", normal)
        self.register_buffer("height", level)
        self.register_buffer("confidence", confidence)

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, N, 1)."""
        return self._residual(self._depth(self.points(motion)))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form: the normal times derivatives of the points, where they are below."""
        points, frame, shared = self.points.linearize(motion)
        depth = self._depth(points)
        slope = self.scale * (depth < 0).to(depth)[..., None]  # *b F N 1 1
        return Linearization(
            self._residual(depth),
            slope * self._along(frame),
            None if shared is None else slope * self._along(shared),
        )

    def second_order(self, motion: Motion, pull: Tensor) -> SecondOrder:
        """Closed form: that of the points that are below."""
        linearized = self.points.linearize(motion)
        below = self.scale * (self._depth(linearized[0]) < 0).to(pull) * pull  # *b F N 1
        on_points = below * self.normal[..., None, None, :]
        return point_curvature(self.points, motion, linearized, on_points)

    def _residual(self, depth: Tensor) -> Residual:
        return Residual(self.scale * depth.clamp(max=0), self.confidence)

    def _depth(self, points: Tensor) -> Tensor:
        """Heights of the points above the floor, (*b, F, N, 1)."""
        along = (points * self.normal[..., None, None, :]).sum(-1)
        return (along - self.height[..., None, None]).unsqueeze(-1)

    def _along(self, derivative: Tensor) -> Tensor:
        """Derivative (*b, F, N, 1, D) along the normal from that of the points."""
        return (self.normal[..., None, None, :, None] * derivative).sum(-2, keepdim=True)
