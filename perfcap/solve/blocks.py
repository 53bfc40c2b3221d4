"""Energies that see a few blocks of a frame's unknowns, in dense normal equations."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from perfcap.solve.energy import Energy, Residual
from perfcap.solve.sparse import BlockLinearization, OffersBlocks


def add_sparse(
    energy: Energy[Any], state: Any, curvature: Tensor, gradient: Tensor
) -> Tensor | None:
    """Add what ``linearize_blocks`` says to (B, F, D, D) and (B, F, D), in place.

    Returns:
        The energy of each batch element, (B,); None, with nothing added, where the state has
        shared unknowns.
    """
    if state.shared_sizes:
        return None
    linear = _linearized(energy, state)
    residual = linear.residual
    index, jacobian = _rows(linear, state)
    weight = _weights(energy, residual).flatten(0, -2)  # P G
    weighted = weight[..., None, None] * jacobian
    dim = gradient.shape[-1]
    place = (index.unsqueeze(-1) * dim + index.unsqueeze(-2)).flatten(1)
    products = (jacobian.mT @ weighted).flatten(1)
    curvature.view(-1, dim * dim).scatter_add_(1, place, products)
    gradient.view(-1, dim).scatter_add_(1, index.flatten(1), _pulled(weighted, residual))
    return energy.cost(residual).reshape(len(curvature))


def sparse_gradient(energy: Energy[Any], state: Any) -> Tensor:
    """Half the gradient of an energy, (*b, F, D), differentiable in all that it holds."""
    linear = _linearized(energy, state)
    residual = linear.residual
    index, jacobian = _rows(linear, state)
    weighted = _weights(energy, residual).flatten(0, -2)[..., None, None] * jacobian
    frame = torch.zeros_like(state.coordinates().frame)
    flat = frame.flatten(0, -2)
    pulled = flat.scatter_add(1, index.flatten(1), _pulled(weighted, residual))
    return pulled.reshape(frame.shape)


def _linearized(energy: Energy[Any], state: Any) -> BlockLinearization:
    assert isinstance(energy, OffersBlocks)
    linear: Any = energy.linearize_blocks(state)
    found: BlockLinearization = linear.as_blocks() if hasattr(linear, "as_blocks") else linear
    lead, q = state.coordinates().frame.shape[:-1], state.block_dim
    found.require_fitting(type(energy).__name__, lead, state.frame_dim // q, q)
    return found


def _rows(linear: BlockLinearization, state: Any) -> tuple[Tensor, Tensor]:
    """Unknowns that groups see (P, G, k q) and the Jacobian in them (P, G, d, k q)."""
    jacobian = linear.jacobian.flatten(0, -5)  # P G k d q
    count = jacobian.shape[-1]
    blocks = linear.blocks.expand(linear.jacobian.shape[:-2]).flatten(0, -3)  # P G k
    jacobian = torch.where((blocks >= 0)[..., None, None], jacobian, 0)
    unknowns = blocks.clamp(min=0).unsqueeze(-1) * count + torch.arange(count).to(blocks)
    return unknowns.flatten(-2), jacobian.transpose(-3, -2).flatten(-2)


def _weights(energy: Energy[Any], residual: Residual) -> Tensor:
    """Weight times confidence times kernel slope of each group, (*b, F, G)."""
    slope = energy.kernel.slope(residual.squared_norm())
    slope = slope if residual.confidence is None else residual.confidence * slope
    weight = energy.weight.to(slope)
    return (weight[..., None, None] if weight.ndim else weight) * slope


def _pulled(weighted: Tensor, residual: Residual) -> Tensor:
    """``J' W r`` of each group's own unknowns, (P, G k q)."""
    value = residual.value.flatten(0, -3).unsqueeze(-1)  # P G d 1
    return (weighted.mT @ value).squeeze(-1).flatten(1)
