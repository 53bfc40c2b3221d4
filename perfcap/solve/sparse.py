"""Energies of many unknowns a frame, each group of residuals seeing a few blocks of them.

A frame of such a state is M blocks of q unknowns, and a problem of its own. ``P`` counts problems:
the frames of all batch elements. Vectors over the unknowns are (P, M, q).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.solve.energy import Coupling, Energy, Objective, Residual, State

_FLOATS = (torch.float32, torch.float64)


@dataclass(frozen=True)
class CoarseSpace:
    """Motions of groups of blocks that cost an energy little.

    Args:
        group: group 0 ... C - 1 of each block, -1 for none, (M,).
        groups: C.
        modes: how a block moves along each of the r motions of its group, (*b, F, M, q, r), or
            (P, M, q, r) inside the solver.
    """

    group: Tensor
    groups: int
    modes: Tensor


@runtime_checkable
class BlockState(Protocol):
    """A state whose frames are blocks of unknowns."""

    @property
    def block_dim(self) -> int:
        """q, unknowns of a block; divides ``frame_dim``."""


class Curvature(Protocol):
    """``J' W J`` of one energy at a state: what conjugate gradients need to know of it.

    Every method adds to a tensor in place: the sums over energies run hundreds of times a solve.
    """

    def add_equations(self, gradient: Tensor, diagonal: Tensor) -> None:
        """Add ``J' W r`` to (P, M, q), the blocks of ``J' W J`` on its diagonal to (P, M, q, q).

        The blocks scale and precondition: where a group names a block twice, what is across may
        be left out.
        """

    def add_product(self, direction: Tensor, product: Tensor, running: Tensor) -> None:
        """Add ``J' W J direction`` to a product, (P, M, q), where ``running`` (P,) or anywhere."""

    def add_coarse(self, space: CoarseSpace, matrix: Tensor) -> None:
        """Add the lower triangle of ``B' J' W J B`` to (P, C, r, C, r), with B the modes.

        Blocks on the diagonal are whole. What the modes hardly change may be left out.
        """


class SparseLinearization(Protocol):
    """What ``Energy.linearize_blocks`` returns: a ``BlockLinearization``, or more structure."""

    @property
    def residual(self) -> Residual:
        """Of the energy, (*b, F, G, d)."""

    def curvature(self, weight: Tensor) -> Curvature:
        """Curvature with the weight (*b, F, G) of each group."""


@runtime_checkable
class OffersBlocks(Protocol):
    """An energy whose groups see a few blocks of a frame's unknowns."""

    def linearize_blocks(self, state: Any) -> SparseLinearization:
        """Residual and derivative at a state."""


@dataclass(frozen=True)
class BlockLinearization:
    """A residual and its derivative in the few blocks that each of its groups sees.

    Args:
        residual: (*b, F, G, d).
        blocks: which blocks of the frame's unknowns a group sees, (*b, F, G, k), -1 for none. A
            block may be named twice; its derivatives add up.
        jacobian: derivative of the residual in the q unknowns of each of them, left perturbations
            as in ``State.retract``, (*b, F, G, k, d, q). What belongs to no block is not read.
    """

    residual: Residual
    blocks: Tensor
    jacobian: Tensor

    def curvature(self, weight: Tensor) -> Curvature:
        """``J' W J`` with the weight (*b, F, G) of each group."""
        lead = self.jacobian.shape[:-2]  # *b F G k
        parts = (
            self.blocks.expand(lead).flatten(0, -3),
            self.jacobian.flatten(0, -5),
            self.residual.value.flatten(0, -3),
            weight.expand(lead[:-1]).flatten(0, -2),
        )
        if is_compiled(self.jacobian):
            from perfcap.solve._blocks_numba import BlockCurvature

            return BlockCurvature.of(*parts)
        from perfcap.solve._blocks_torch import BlockCurvature as Plain

        return Plain(*parts)


def is_compiled(tensor: Tensor) -> bool:
    """Whether compiled loops stand in for torch: solvers see tensors without gradients only."""
    return tensor.is_cpu and tensor.dtype in _FLOATS


@dataclass(frozen=True)
class Size:
    """P problems of M blocks of q unknowns, typed as ``like``; problems are frames, (*b, F)."""

    frames: torch.Size
    blocks: int
    unknowns: int
    like: Tensor

    @classmethod
    def of(cls, state: State) -> Size:
        """Sizes of a state.

        Raises:
            InputError: the state has no blocks, or unknowns that frames share.
        """
        if not isinstance(state, BlockState):
            raise InputError(
                f"state is a {type(state).__name__}, which has no block_dim; use "
                "LevenbergMarquardt for frames that are one block"
            )
        if state.shared_dim:
            raise InputError(
                f"state has {state.shared_dim} unknowns that frames share, expected none: every "
                "frame is solved by itself; use LevenbergMarquardt"
            )
        frame = state.coordinates().frame
        blocks = state.frame_dim // state.block_dim
        return cls(frame.shape[:-1], blocks, state.block_dim, frame.new_empty(0))

    @property
    def problems(self) -> int:
        """P."""
        return self.frames.numel()

    @property
    def vector(self) -> tuple[int, int, int]:
        """Shape (P, M, q)."""
        return self.problems, self.blocks, self.unknowns

    def zeros(self, *more: int) -> Tensor:
        """Zeros (P, M, q, *more) of the state's type and device."""
        return self.like.new_zeros(*self.vector, *more)


@dataclass(frozen=True)
class SparseEquations:
    """The quadratic model of an objective at a state, its matrix only as a sum of products.

    All derivatives leave out the factor 2 of a sum of squares: near the state the energy is
    ``E + 2 g.d + d.H d``.

    Args:
        terms: value of each energy by name, (P,).
        curvatures: of each energy.
        gradient: g, (P, M, q).
        diagonal: blocks of H on its diagonal, (P, M, q, q).
    """

    terms: dict[str, Tensor]
    curvatures: tuple[Curvature, ...]
    gradient: Tensor
    diagonal: Tensor

    @property
    def energy(self) -> Tensor:
        """Total energy, (P,)."""
        return torch.stack(list(self.terms.values())).sum(0)

    def finite(self) -> Tensor:
        """Whether all numbers of a problem are, (P,)."""
        # a sum is not finite as soon as one of its terms is not
        sums = self.energy + self.gradient.flatten(1).sum(-1) + self.diagonal.flatten(1).sum(-1)
        return sums.isfinite()


def linearize(objective: Objective, state: State, size: Size) -> SparseEquations:
    """Linearize every energy at a state of known size.

    Raises:
        InputError: an energy offers no ``linearize_blocks``, or couples frames.
    """
    gradient, diagonal = size.zeros(), size.zeros(size.unknowns)
    terms, curvatures = {}, []
    for name, energy, offers in _sparse_energies(objective):
        linear = offers.linearize_blocks(state)
        squared = linear.residual.squared_norm()
        terms[name] = _frame_costs(energy, squared, size)
        curvature = linear.curvature(_group_weight(energy, linear.residual, squared))
        curvature.add_equations(gradient, diagonal)
        curvatures.append(curvature)
    return SparseEquations(terms, tuple(curvatures), gradient, diagonal)


def evaluate(objective: Objective, state: State, size: Size) -> dict[str, Tensor]:
    """Energies of each problem by name, (P,)."""
    return {
        name: _frame_costs(energy, energy.residual(state).squared_norm(), size)
        for name, energy in objective.items()
    }


def _sparse_energies(objective: Objective) -> Iterator[tuple[str, Energy[Any], OffersBlocks]]:
    for name, energy in objective.items():
        if not isinstance(energy, OffersBlocks) or energy.coupling is not Coupling.FRAME:
            raise InputError(
                f"energy '{name}' ({type(energy).__name__}) offers no linearize_blocks for single "
                "frames; give it one, or use LevenbergMarquardt"
            )
        yield name, energy, energy


def _frame_costs(energy: Energy[Any], squared: Tensor, size: Size) -> Tensor:
    """``Energy.cost`` of every frame by itself, (P,); squared norms are (*b, F, G)."""
    cost = energy.kernel.value(squared).sum(-1)
    return (energy.weight.to(cost)[..., None] * cost).expand(size.frames).reshape(-1)


def _group_weight(energy: Energy[Any], residual: Residual, squared: Tensor) -> Tensor:
    """Weight times confidence times slope of the kernel, (*b, F, G): reweighted least squares."""
    slope = energy.kernel.slope(squared)
    if residual.confidence is not None:
        slope = residual.confidence * slope
    return energy.weight.to(slope)[..., None, None] * slope
