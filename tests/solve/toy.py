"""A small state and energies with every kind of structure, and their dense twin."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.solve import (
    Energy,
    Objective,
    Residual,
    State,
    Step,
    WindowEnergy,
)


def cosine_basis(rows: int, frames: int) -> Tensor:
    """Orthonormal DCT-II basis, (rows, frames)."""
    time = (torch.arange(frames, dtype=torch.float64) + 0.5) * math.pi / frames
    basis = torch.cos(torch.arange(rows, dtype=torch.float64)[:, None] * time)
    return basis / basis.norm(dim=-1, keepdim=True)


@dataclass(frozen=True)
class Frames:
    """Frames (*b, F, D) and shared unknowns (*b, S), both plain vectors."""

    frame: Tensor
    shared: Tensor

    @property
    def frame_dim(self) -> int:
        return self.frame.shape[-1]

    @property
    def shared_sizes(self) -> dict[str, int]:
        return {"all": self.shared.shape[-1]} if self.shared.shape[-1] else {}

    def retract(self, step: Step) -> Frames:
        return Frames(self.frame + step.frame, self.shared + step.shared)

    def local(self, other: Frames) -> Step:
        return Step(other.frame - self.frame, other.shared - self.shared)

    def coordinates(self) -> Step:
        return Step(self.frame, self.shared)

    def to(self, dtype: torch.dtype) -> Frames:
        return Frames(self.frame.to(dtype), self.shared.to(dtype))


class Observation(Energy):
    """``stretch * tanh(M_f x_f) - target_f`` in groups of two, stretched by a shared unknown."""

    def __init__(self, matrix, target, confidence=None, weight=1.0, kernel=None, shared=False):
        super().__init__(weight, kernel)
        self.register_buffer("matrix", matrix)  # *b F 2G D
        self.register_buffer("target", target)  # *b F 2G
        self.register_buffer("confidence", confidence)
        self.sees = ("all",) if shared else ()

    def residual(self, state: State) -> Residual:
        seen = torch.tanh((self.matrix @ state.frame.unsqueeze(-1)).squeeze(-1))
        if self.sees:
            seen = seen * (1 + state.shared.sum(-1)[..., None, None])
            seen = torch.cat((seen[..., :1] + state.shared[..., None, :1], seen[..., 1:]), -1)
        value = (seen - self.target).unflatten(-1, (-1, 2))
        return Residual(value, self.confidence)


class SharedPrior(Energy):
    """Pulls the shared unknowns to zero; frames do not matter."""

    sees = ("all",)

    def residual(self, state: State) -> Residual:
        shape = (*state.frame.shape[:-1], 1, state.shared.shape[-1])
        return Residual(state.shared[..., None, None, :].expand(shape))


class Smoothness(WindowEnergy):
    """Frames as features, the first two unknowns wrapped on a circle so that E = D + 1."""

    def __init__(self, basis, keep, scale, weight=1.0):
        super().__init__(basis, keep, weight)
        self.register_buffer("scale", scale)

    def features(self, state: State) -> Tensor:
        x = state.frame
        circle = torch.stack((x[..., 0].cos(), x[..., 0].sin()), -1)
        return torch.cat((circle * self.scale[0], x[..., 1:] * self.scale[1:]), -1)


class Product(WindowEnergy):
    """Features of low rank: fewer than the unknowns of a frame."""

    def __init__(self, basis, keep, weight=1.0):
        super().__init__(basis, keep, weight)

    def features(self, state: State) -> Tensor:
        x = state.frame
        return torch.stack((x[..., 0] + x[..., 1] ** 2, x[..., 2]), -1)


def toy(
    *,
    batch: tuple[int, ...] = (),
    frames: int = 7,
    dim: int = 4,
    shared: int = 0,
    data: float = 1.0,
    groups: int = 3,
    windows: int = 1,
    seed: int = 0,
    kernel=None,
) -> tuple[Objective, Frames]:
    """An objective and a state near which it is smooth."""
    random = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=random, dtype=torch.float64)

    rows = 2 * groups
    energies: dict[str, Energy] = {
        "data": Observation(
            0.5 * normal(*batch, frames, rows, dim),
            0.3 * normal(*batch, frames, rows),
            torch.rand(*batch, frames, groups, generator=random, dtype=torch.float64),
            weight=data,
            kernel=kernel,
            shared=shared > 0,
        )
    }
    if shared > 0:
        energies["prior"] = SharedPrior(weight=0.2)
    if windows > 0:
        basis = cosine_basis(3, frames)
        keep = torch.ones(3, dtype=torch.float64)
        scale = torch.linspace(0.5, 2.0, dim, dtype=torch.float64)
        energies["smooth"] = Smoothness(basis, keep, scale, weight=1.5)
    if windows > 1:
        keep = torch.tensor([1.0, 0.6], dtype=torch.float64)
        energies["product"] = Product(cosine_basis(2, frames), keep, weight=0.7)
    state = Frames(0.3 * normal(*batch, frames, dim), 0.1 * normal(*batch, shared))
    return Objective(energies), state


def dense_derivatives(objective: Objective, state: Frames) -> tuple[Tensor, Tensor]:
    """Half the gradient (N,) and the Gauss-Newton matrix (N, N) of a state without batch."""
    frames, dim = state.frame.shape
    rows = []

    def residuals(flat: Tensor) -> Tensor:
        moved = Frames(flat[: frames * dim].reshape(frames, dim), flat[frames * dim :])
        parts = []
        for energy in objective.energies.values():
            residual = energy.residual(moved)
            slope = energy.kernel.slope(residual.squared_norm()).detach()
            confidence = 1.0 if residual.confidence is None else residual.confidence
            scale = (energy.weight * slope * confidence).sqrt().unsqueeze(-1)
            parts.append((scale * residual.value).flatten())
        return torch.cat(parts)

    flat = torch.cat((state.frame.flatten(), state.shared))
    jacobian = torch.autograd.functional.jacobian(residuals, flat)
    rows = residuals(flat)
    return jacobian.T @ rows, jacobian.T @ jacobian
