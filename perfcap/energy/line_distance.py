"""Distance of points from lines in space, such as the rays of what a view shows of them."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import Points
from perfcap.energy._arguments import known_places, require_confidence, require_unit, seen_by
from perfcap.errors import InputError
from perfcap.geometry.plain import is_readable
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel

_UNIT = 1e-3  # how far the length of a direction may be from one


def line_through(place: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
    """Pluecker line (D, M) with X x D = M for every X on it (Liu et al. 2013, Eq. 3).

    Args:
        place: a point of the line, (..., 3), metres.
        direction: (..., 3), of any length but zero, which gives numbers that are not finite.

    Returns:
        Unit direction D and moment M, (..., 3) each.
    """
    unit = direction / torch.linalg.vector_norm(direction, dim=-1, keepdim=True)
    return unit, torch.linalg.cross(place, unit)


class LineDistance(Energy[Motion]):
    """Squared distance of points from Pluecker lines (Liu et al. 2013, Eq. 4).

    A residual group is one point and its line: (V x D - M) / unit, 3 entries, whose norm is the
    distance. The paper's w_i is the confidence, its one half is not there.

    Args:
        points: N of them, each with one line.
        direction: D, (*b, F, N, 3), of length one, in the world.
        moment: M, (*b, F, N, 3), metres, as of ``line_through``.
        confidence: (*b, F, N); 1 if not given. Lines of confidence 0 may be any numbers.
        weight: of the energy.
        kernel: acts on the squared residual, in ``unit``.
        unit: metres that count as one.

    Raises:
        InputError: shapes that do not fit, negative confidence, directions of another length, or
            a unit that is none.
    """

    coupling = Coupling.FRAME
    direction: Tensor
    moment: Tensor
    confidence: Tensor

    def __init__(
        self,
        points: Points,
        direction: Tensor,
        moment: Tensor,
        confidence: Tensor | None = None,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float = 1.0,
    ) -> None:
        if confidence is None:
            confidence = torch.ones_like(direction[..., 0])
        require_unit(unit)
        sees = seen_by(points)
        _require_lines(points.count, direction, moment, confidence)
        super().__init__(weight, kernel)
        self.points, self.sees = points, sees
        moment = known_places(moment, confidence, "moment")
        there, none = (confidence > 0)[..., None], direction.new_zeros(())
        self.register_buffer("direction", direction.where(there, none) / unit)
        self.register_buffer("moment", moment.where(there, none) / unit)
        self.register_buffer("confidence", confidence)

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, N, 3)."""
        return self._residual(self.points(motion))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form: derivative of each point, times its direction."""
        points, frame, shared = self.points.linearize(motion)
        of_shared = None if shared is None else self._crossed(shared)
        return Linearization(self._residual(points), self._crossed(frame), of_shared)

    def _residual(self, points: Tensor) -> Residual:
        if points.shape[-3] != self.direction.shape[-3]:
            raise InputError(
                f"direction has {self.direction.shape[-3]} frames but the motion "
                f"{points.shape[-3]}; give lines for each frame"
            )
        error = torch.linalg.cross(points, self.direction.expand_as(points)) - self.moment
        return Residual(error, self.confidence)

    def _crossed(self, derivative: Tensor) -> Tensor:
        """Derivative of V x D from that of V, (*b, F, N, 3, D)."""
        direction = self.direction.unsqueeze(-1).expand_as(derivative)
        crossed: Tensor = torch.linalg.cross(derivative, direction, dim=-2)
        return crossed


def limb_errors(squared: Tensor, confidence: Tensor, limb: Tensor, limbs: int) -> Tensor:
    """Mean squared distance of each limb, E_m (Liu et al. 2013, Eq. 5).

    The paper calls a limb misaligned above 400 mm^2; pass contour pairs only, as it does.

    Args:
        squared: squared distances of pairs, (*b, F, N), in any unit.
        confidence: (*b, F, N); pairs of confidence 0 are left out, others count alike.
        limb: which limb each pair moves with, (*b, F, N), 0 to ``limbs`` - 1.
        limbs: their number.

    Returns:
        (*b, F, limbs), in the unit of ``squared``; zero where a limb has no pair.
    """
    there = confidence > 0
    empty = squared.new_zeros(*squared.shape[:-1], limbs)
    total = empty.scatter_add(-1, limb, torch.where(there, squared, 0))
    count = empty.scatter_add(-1, limb, there.to(squared))
    return total / count.clamp(min=1)


def _require_lines(count: int, direction: Tensor, moment: Tensor, confidence: Tensor) -> None:
    fits = direction.dim() > 2 and direction.shape[-2:] == (count, 3)
    if not fits or moment.shape != direction.shape or confidence.shape != direction.shape[:-1]:
        raise InputError(
            f"direction has shape {tuple(direction.shape)}, moment {tuple(moment.shape)}, "
            f"confidence {tuple(confidence.shape)}; give (*b, F, {count}, 3) twice and "
            f"(*b, F, {count})"
        )
    if not is_readable(direction):
        return
    require_confidence(confidence)
    length = torch.linalg.vector_norm(direction.detach(), dim=-1)[confidence > 0]
    if not bool(((length - 1).abs() < _UNIT).all()):
        raise InputError("direction is not of length one everywhere; make lines by line_through")
