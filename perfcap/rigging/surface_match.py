"""Energies that fit a body model to a surface."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import Points
from perfcap.solve import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel


@dataclass(frozen=True, eq=False)
class Matches:
    """Where points should be: place (N, 3), unit normal of the surface there (N, 3), trust (N,)."""

    place: Tensor
    normal: Tensor
    trust: Tensor


class SurfaceMatch(Energy[Motion]):
    """Distance of points of a body to places on a surface, mostly along its normal.

    The residual of a point is ``(slide + (1 - slide) n n') (x - y)``: points may slide along the
    surface at a price of ``slide``, which keeps smooth limbs from turning in place.

    Args:
        points: of the body, N; their shape is unknown too.
        matches: of each.
        slide: 1 is the plain distance, 0 the distance to the tangent plane.
        weight: of the energy.
        kernel: acts on the squared residual, metres.
    """

    coupling = Coupling.FRAME
    place: Tensor
    trust: Tensor
    metric: Tensor

    def __init__(
        self,
        points: Points,
        matches: Matches,
        slide: float = 0.3,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
    ) -> None:
        super().__init__(weight, kernel)
        self.points, self.sees = points, points.sees
        normal = matches.normal
        outer = normal[:, :, None] * normal[:, None]
        self.register_buffer("metric", slide * torch.eye(3).to(outer) + (1 - slide) * outer)
        self.register_buffer("place", matches.place)
        self.register_buffer("trust", matches.trust)

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, N, 3)."""
        return self._residual(self.points(motion))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form."""
        points, frame, shared = self.points.linearize(motion)
        of_shared = None if shared is None else self.metric @ shared
        return Linearization(self._residual(points), self.metric @ frame, of_shared)

    def _residual(self, points: Tensor) -> Residual:
        error = (self.metric @ (points - self.place)[..., None]).squeeze(-1)
        return Residual(error, self.trust.expand(error.shape[:-1]))
