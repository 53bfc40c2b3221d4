"""Second derivatives of energies that see a motion through points."""

from __future__ import annotations

from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import Linearized, Points
from perfcap.solve.second_order import SecondOrder, points_second_order


def point_curvature(
    points: Points,
    motion: Motion,
    linearized: Linearized,
    pull: Tensor,
    moved: tuple[Tensor, Tensor | None] | None = None,
    curvature: Tensor | None = None,
) -> SecondOrder:
    """Chain rule of second order: ``J' K J`` and the points' own second derivatives.

    Args:
        points: that the energy sees.
        motion: where.
        linearized: ``points.linearize(motion)``.
        pull: derivative of what is differentiated in the points, (*b, F, N, 3).
        moved: J, derivatives of other points (*b, F, M, 3, D) and (*b, F, M, 3, S'); those of the
            points if not given.
        curvature: K of each of these points, symmetric, (*b, F, M, 3, 3); none if not given.
    """
    _, own, own_shared = linearized
    bent = points_second_order(points, motion, linearized, pull)
    if curvature is None:
        return bent
    rows, shared_rows = (own, own_shared) if moved is None else moved
    curved = (curvature @ rows).flatten(-3, -2)
    flat = rows.flatten(-3, -2)
    frame = bent.frame + flat.mT @ curved
    if bent.border is None or bent.shared is None or shared_rows is None:
        return SecondOrder(frame)
    flat_shared = shared_rows.flatten(-3, -2)
    curved_shared = (curvature @ shared_rows).flatten(-3, -2)
    shared = bent.shared + (flat_shared.mT @ curved_shared).sum(-3)
    return SecondOrder(frame, bent.border + curved.mT @ flat_shared, shared)
