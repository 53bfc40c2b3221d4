"""Second derivatives of energies that see a motion through its landmarks."""

from __future__ import annotations

from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.kinematic_curvature import kinematic_curvature
from perfcap.actor.motion import Motion
from perfcap.solve.second_order import SecondOrder

Linearized = tuple[Tensor, Tensor, Tensor | None]


def landmark_curvature(
    actor: Actor,
    motion: Motion,
    linearized: Linearized,
    pull: Tensor,
    moved: tuple[Tensor, Tensor | None] | None = None,
    curvature: Tensor | None = None,
) -> SecondOrder:
    """Chain rule of second order: ``J' K J`` and the landmarks' own second derivatives.

    Args:
        actor: whose landmarks.
        motion: where.
        linearized: ``actor.skeleton.linearize(motion)``.
        pull: derivative of what is differentiated in the landmarks, (*b, F, L, 3).
        moved: J, derivatives of points (*b, F, N, 3, D) and (*b, F, N, 3, S); those of the
            landmarks if not given.
        curvature: K of each of these points, symmetric, (*b, F, N, 3, 3); none if not given.
    """
    _, own, own_shared = linearized
    frame, border, shared = kinematic_curvature(actor.skeleton, motion, own, pull)
    if curvature is None:
        return SecondOrder(frame, border, shared)
    rows, shared_rows = (own, own_shared) if moved is None else moved
    curved = (curvature @ rows).flatten(-3, -2)
    flat = rows.flatten(-3, -2)
    frame = frame + flat.mT @ curved
    if border is None or shared is None or shared_rows is None:
        return SecondOrder(frame)
    flat_shared = shared_rows.flatten(-3, -2)
    curved_shared = (curvature @ shared_rows).flatten(-3, -2)
    shared = shared + (flat_shared.mT @ curved_shared).sum(-3)
    return SecondOrder(frame, border + curved.mT @ flat_shared, shared)
