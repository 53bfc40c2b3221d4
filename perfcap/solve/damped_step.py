"""The minimiser of a damped model within the bounds, and what a method asks about it.

A window solve spends a large part of its time between operations, so compiled loops do all of this
in two calls, in memory that is allocated once a solve (``_step_room.Room``); the same in torch
serves gradients, graphics cards and shared unknowns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from perfcap.geometry.plain import is_plain
from perfcap.solve.box_step import box_step
from perfcap.solve.damped_model import DampedModel, DampedStep, negligible_share
from perfcap.solve.factorization import factorize
from perfcap.solve.normal_equations import NormalEquations

if TYPE_CHECKING:
    from perfcap.solve._step_room import Room


def room_for_steps(equations: NormalEquations) -> Room | None:
    """Memory for the steps of a whole solve, None where torch has to take them.

    Which of the two it is is settled here, once a solve.
    """
    tensors = [equations.curvature, equations.frame_gradient]
    for window in equations.windows:
        tensors += [window.jacobian, window.features, window.basis, window.plain_basis]
        tensors += [window.complement, window.keep]
    if equations.layout.shared_dim or not is_plain(*tensors):
        return None
    from perfcap.solve._step_room import Room

    return Room.of(equations)


def damped_step(model: DampedModel, room: Room | None = None) -> DampedStep:
    """Minimise the damped model over the box.

    Args:
        model: what to minimise.
        room: memory of this solve for compiled loops; they are used if it is given.
    """
    if room is not None:
        from perfcap.solve import _step_numba

        return _step_numba.damped_step(model, room)
    equations, damping = model.equations, model.damping()
    factorization = factorize(equations, damping)
    newton = factorization.newton_step(equations)
    valid = factorization.valid & newton.isfinite().all(-1)
    if not all(model.running):
        valid = valid & torch.tensor(model.running, device=valid.device)
    newton = torch.where(valid.unsqueeze(-1), newton, 0)
    step, multipliers = newton, model.multipliers
    if model.box is not None:
        warm = torch.where(valid.unsqueeze(-1), multipliers, 0)
        step, multipliers = box_step(equations, factorization, damping, newton, model.box, warm)
        valid = valid & step.isfinite().all(-1)
        step = torch.where(valid.unsqueeze(-1), step, 0)
    size, reach = ((model.scale * x.square()).sum(-1) for x in (step, model.at))
    return DampedStep(
        step=step,
        damping=damping,
        multipliers=multipliers,
        valid=valid,
        promised=equations.decrease(step),
        share=torch.where(model.here > 0, damping / model.here, 0).amax(-1),
        negligible=size <= negligible_share(step.dtype) * reach,
    )
