"""The gradient and the Hessian of an objective at a solution, for differentiating it.

Halves of both, like the normal equations: near a state the energy is ``E + 2 g.d + d.H d``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor

from perfcap.solve.assembly import add_block
from perfcap.solve.energy import Energy, Linearization, Objective, State, WindowEnergy
from perfcap.solve.kernels import Kernel
from perfcap.solve.layout import Layout
from perfcap.solve.normal_equations import NormalEquations
from perfcap.solve.products import apply_transposed
from perfcap.solve.second_order import second_order


@runtime_checkable
class OffersGradient(Protocol):
    """An energy whose ``linearize`` does not lead back to what the energy was made of."""

    def gradient(self, state: Any) -> tuple[Tensor, Tensor | None]:
        """Half its gradient, (*b, F, D) and (*b, S'), differentiable in all that it holds."""


def gradient(objective: Objective, state: State, layout: Layout) -> Tensor:
    """Half the gradient of the energy, (B, N), at a state that carries no graph.

    It is put together from the energies' closed derivatives, so its graph leads to what energies
    hold (detections, cameras, weights, bones) and nowhere else, and needs no second backward pass.
    """
    frame = torch.zeros_like(state.coordinates().frame)
    shared = torch.zeros_like(state.coordinates().shared)
    for energy in _energies(objective):
        own, of_shared = energy_gradient(energy, state)
        frame = frame + own
        if of_shared is not None:
            shared = _added(shared, layout.seen(energy.sees), of_shared)
    rows = frame.expand(*layout.batch, *frame.shape[-2:]).reshape(layout.batch_size, -1)
    if not layout.shared_dim:
        return rows
    return torch.cat((rows, layout.per_element(shared)), -1)


def energy_gradient(energy: Energy[Any], state: State) -> tuple[Tensor, Tensor | None]:
    """Half the gradient of one energy, (*b, F, D) and (*b, S'), None where nothing is shared."""
    if isinstance(energy, OffersGradient):
        return energy.gradient(state)
    if isinstance(energy, WindowEnergy):
        return _window_gradient(energy, state), None
    return _frame_gradient(energy, state)


def _added(whole: Tensor, columns: slice | list[int], part: Tensor) -> Tensor:
    """A tensor (..., S) with a part (..., S') added to some columns; neither is written to."""
    padded = part.new_zeros(*part.shape[:-1], whole.shape[-1])
    padded[..., columns] = part
    return whole + padded


def _with_block(matrix: Tensor, index: slice | list[int], block: Tensor) -> Tensor:
    """A matrix (..., S, S) with a block added to some rows and columns; neither is written to."""
    padded = torch.zeros_like(matrix)
    add_block(padded, index, block)
    return matrix + padded


def _energies(objective: Objective) -> list[Energy[Any]]:
    return [energy for _, energy in objective.items()]


def _frame_gradient(energy: Energy[Any], state: State) -> tuple[Tensor, Tensor | None]:
    linear = energy.linearize(state)
    pull = _pull(energy, linear).flatten(-2)  # *b F Gd
    frame = apply_transposed(linear.frame.flatten(-3, -2), pull)
    if linear.shared is None:
        return frame, None
    return frame, apply_transposed(linear.shared.flatten(-3, -2), pull).sum(-2)


def _window_gradient(energy: WindowEnergy[Any], state: State) -> Tensor:
    features, jacobian = energy.linearize_features(state)
    return apply_transposed(jacobian, _window_pull(energy, features))


def _pull(energy: Energy[Any], linear: Linearization) -> Tensor:
    """Half the derivative of the energy in its residual, (*b, F, G, d)."""
    residual = linear.residual
    slope = energy.kernel.slope(residual.squared_norm())
    if residual.confidence is not None:
        slope = residual.confidence * slope
    return _spread(energy.weight, slope).unsqueeze(-1) * slope.unsqueeze(-1) * residual.value


def _window_pull(energy: WindowEnergy[Any], features: Tensor) -> Tensor:
    """Half the derivative of the energy in its features, (*b, F, E)."""
    return _spread(energy.weight, features) * energy.filter(energy.filter(features))


def _spread(weight: Tensor, like: Tensor) -> Tensor:
    """A weight, a number or (*b,), in the precision of values (*b, F, G) and to multiply them."""
    weight = weight.to(like)
    return weight[..., None, None] if weight.ndim else weight


def hessian(objective: Objective, state: State, equations: NormalEquations) -> NormalEquations:
    """The normal equations at a state with half the Hessian in place of Gauss-Newton's matrix.

    What Gauss-Newton leaves out, the second derivatives of residuals and kernels, is
    block-diagonal in the frames, also for window energies, whose features see one frame each.

    Args:
        objective: the energies.
        state: where, without a graph.
        equations: ``assemble(objective, state)``.
    """
    layout = equations.layout
    curvature, border = equations.curvature, equations.border
    shared = equations.shared_curvature
    for energy in _energies(objective):
        if isinstance(energy, WindowEnergy):
            pull = _window_pull(energy, energy.features(state))
        else:
            linear = energy.linearize(state)
            pull = _pull(energy, linear)
            bent = _bent_kernel(energy, linear, layout)
            if bent is not None:
                curvature = curvature + bent[0]
                if bent[1] is not None and bent[2] is not None:
                    border = _added(border, layout.seen(energy.sees), bent[1])
                    shared = _with_block(shared, layout.seen(energy.sees), bent[2])
        left_out = second_order(energy, state, pull)
        if left_out is None:
            continue
        curvature = curvature + layout.per_element(left_out.frame)
        if left_out.border is not None and left_out.shared is not None:
            seen = layout.seen(energy.sees)
            border = _added(border, seen, layout.per_element(left_out.border))
            shared = _with_block(shared, seen, layout.per_element(left_out.shared))
    return replace(equations, curvature=curvature, border=border, shared_curvature=shared)


def _bent_kernel(
    energy: Energy[Any], linear: Linearization, layout: Layout
) -> tuple[Tensor, Tensor | None, Tensor | None] | None:
    """What the second derivative of a robust kernel adds to the blocks; None where it is zero.

    With s = c |r|^2 it is ``2 w rho''(s) c^2 (J'r) (J'r)'`` for each group.
    """
    residual = linear.residual
    bend = kernel_bend(energy.kernel, residual.squared_norm())
    if bend is None:
        return None
    if residual.confidence is not None:
        bend = bend * residual.confidence.square()
    weight = layout.per_element(2 * _spread(energy.weight, bend) * bend)  # B F G
    value = residual.value.unsqueeze(-2)
    frame = layout.per_element((value @ linear.frame).squeeze(-2))  # B F G D
    weighted = weight.unsqueeze(-1) * frame
    own = frame.mT @ weighted
    if linear.shared is None:
        return own, None, None
    shared = layout.per_element((value @ linear.shared).squeeze(-2))  # B F G S'
    of_shared = (shared.mT @ (weight.unsqueeze(-1) * shared)).sum(1)
    return own, weighted.mT @ shared, of_shared


def kernel_bend(kernel: Kernel, squared: Tensor) -> Tensor | None:
    """Second derivative rho''(s) of a kernel; None where its slope is constant."""
    with torch.enable_grad():
        at = squared.detach().requires_grad_()
        slope = kernel.slope(at)
        if not slope.requires_grad:
            return None
        bend: Tensor = torch.autograd.grad(slope.sum(), at)[0]
    return bend
