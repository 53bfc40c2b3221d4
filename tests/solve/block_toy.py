"""A state of many blocks a frame, and energies whose groups see a few of them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.solve import Energy, Objective, Residual, Step
from perfcap.solve.coarse_space import CoarseSpace
from perfcap.solve.sparse import BlockLinearization


@dataclass(frozen=True)
class Blocks:
    """Plain vectors (*b, F, M, q)."""

    values: Tensor

    @property
    def block_dim(self) -> int:
        return self.values.shape[-1]

    @property
    def frame_dim(self) -> int:
        return self.values.shape[-1] * self.values.shape[-2]

    @property
    def shared_sizes(self) -> dict[str, int]:
        return {}

    def retract(self, step: Step) -> Blocks:
        return Blocks(self.values + step.frame.unflatten(-1, self.values.shape[-2:]))

    def local(self, other: Blocks) -> Step:
        return self._step(other.values - self.values)

    def coordinates(self) -> Step:
        return self._step(self.values)

    def _step(self, values: Tensor) -> Step:
        return Step(values.flatten(-2), values.new_zeros(*values.shape[:-3], 0))


class Chain(Energy[Blocks]):
    """Neighbours i, i + 1 differ by ``target``, measured through a bent ruler."""

    def __init__(self, target, weight=1.0, kernel=None, bend=0.3):
        super().__init__(weight, kernel)
        self.register_buffer("target", target)  # *b F M-1 q
        self.bend = bend

    def residual(self, state):
        x = state.values
        gap = x[..., 1:, :] - x[..., :-1, :] + self.bend * torch.sin(x[..., 1:, :])
        return Residual(gap - self.target)

    def linearize_blocks(self, state):
        x = state.values
        lead, links, q = x.shape[:-2], x.shape[-2] - 1, x.shape[-1]
        start = torch.arange(links)
        blocks = torch.stack((start, torch.full_like(start, -1), start + 1), -1)
        eye = torch.eye(q, dtype=x.dtype).expand(*lead, links, q, q)
        nothing = torch.full_like(eye, torch.nan)  # is not to be read
        end = eye * (1 + self.bend * x[..., 1:, :].cos()).unsqueeze(-1)
        jacobian = torch.stack((-eye, nothing, end), -3)
        return BlockLinearization(self.residual(state), blocks.expand(*lead, links, 3), jacobian)


class StiffChain(Chain):
    """Knows that pairs of neighbours move together at little cost."""

    def coarse_space(self, state):
        count, q = state.values.shape[-2:]
        group = torch.arange(count) // 4
        eye = torch.eye(q, dtype=state.values.dtype)
        return CoarseSpace(group, int(group[-1]) + 1, eye.expand(*state.values.shape, q))


class Sight(Energy[Blocks]):
    """Scalar products of a few blocks with given vectors, one row a group; blocks may repeat."""

    def __init__(self, blocks, rows, target, confidence=None, weight=1.0, kernel=None):
        super().__init__(weight, kernel)
        self.register_buffer("blocks", blocks)  # *b F G k
        self.register_buffer("rows", rows)  # *b F G k q
        self.register_buffer("target", target)  # *b F G
        self.register_buffer("confidence", confidence)

    def residual(self, state):
        return Residual(torch.sin(self._inner(state) - self.target).unsqueeze(-1), self.confidence)

    def linearize_blocks(self, state):
        slope = torch.cos(self._inner(state) - self.target)
        jacobian = slope[..., None, None] * self.rows
        return BlockLinearization(self.residual(state), self.blocks, jacobian.unsqueeze(-2))

    def _inner(self, state):
        x = state.values
        slots = self.blocks.flatten(-2)[..., None].expand(*self.blocks.shape[:-2], -1, x.shape[-1])
        seen = x.gather(-2, slots).reshape(self.rows.shape)
        return (self.rows * seen).sum((-2, -1))


def block_toy(
    *,
    batch=(),
    frames=3,
    blocks=9,
    unknowns=2,
    groups=14,
    seed=0,
    kernel=None,
    chain=Chain,
    repeat=True,
) -> tuple[Objective, Blocks]:
    """An objective and a state near its minimum; groups name some blocks twice if ``repeat``."""
    random = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*batch, frames, *shape, generator=random, dtype=torch.float64)

    seen = torch.rand(*batch, frames, groups, blocks, generator=random).argsort(-1)[..., :3]
    if repeat:
        seen[..., 0, :2] = 4
    confidence = torch.rand(*batch, frames, groups, generator=random, dtype=torch.float64)
    confidence[..., 1] = 0
    sight = Sight(
        seen, 0.6 * normal(groups, 3, unknowns), 0.2 * normal(groups), confidence, 0.7, kernel
    )
    energies = {"chain": chain(0.2 * normal(blocks - 1, unknowns), 0.8), "sight": sight}
    return Objective(energies), Blocks(0.3 * normal(blocks, unknowns))


def dense(objective: Objective, state: Blocks) -> tuple[Tensor, Tensor]:
    """Half the gradient (P, N) and the Gauss-Newton matrix (P, N, N) of every frame."""
    gradient, matrix = 0.0, 0.0
    for energy in objective.energies.values():
        linear = energy.linearize(state)
        residual = linear.residual
        weight = energy.weight * energy.kernel.slope(residual.squared_norm())
        if residual.confidence is not None:
            weight = weight * residual.confidence
        rows = linear.frame.flatten(-3, -2)
        pull = (weight.unsqueeze(-1) * residual.value).flatten(-2)
        scale = weight.unsqueeze(-1).expand_as(residual.value).flatten(-2).unsqueeze(-1)
        gradient = gradient + (rows.mT @ pull.unsqueeze(-1)).squeeze(-1)
        matrix = matrix + rows.mT @ (scale * rows)
    unknowns = state.frame_dim
    return gradient.reshape(-1, unknowns), matrix.reshape(-1, unknowns, unknowns)
