"""Frames of many blocks of unknowns as problems of their own, and their normal equations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor

from perfcap.array_checks import require_indices, require_shape
from perfcap.errors import InputError
from perfcap.geometry.plain import is_plain
from perfcap.solve.coarse_space import CoarseSpace
from perfcap.solve.energy import Coupling, Energy, Objective, Residual, State, total
from perfcap.solve.energy_checks import fits, require_weight
from perfcap.solve.sparse import BlockLinearization, Curvature, OffersBlocks, OffersCoarseSpace


@runtime_checkable
class BlockState(Protocol):
    """A state whose frames are blocks of unknowns."""

    @property
    def block_dim(self) -> int:
        """q, unknowns of a block; divides ``frame_dim``."""


@dataclass(frozen=True)
class SparseEquations:
    """The quadratic model of an objective at a state, its matrix only as a sum of products.

    All derivatives leave out the factor 2 of a sum of squares: near the state the energy is
    ``E + 2 g.d + d.H d``.

    Args:
        terms: value of each energy by name, (P,).
        energy: their sum, (P,).
        curvatures: of each energy.
        gradient: g, (P, M, q).
        diagonal: lower triangles of the blocks on the diagonal of H, (P, M, q, q).
    """

    terms: dict[str, Tensor]
    energy: Tensor
    curvatures: tuple[Curvature, ...]
    gradient: Tensor
    diagonal: Tensor

    def finite(self) -> Tensor:
        """Whether all numbers of a problem are, (P,)."""
        # a sum is not finite as soon as one of its terms is not
        sums = self.energy + self.gradient.flatten(1).sum(-1) + self.diagonal.flatten(1).sum(-1)
        return sums.isfinite()


@dataclass(frozen=True)
class SparseProblem:
    """P problems of M blocks of q unknowns: the frames (*b, F) of an objective's states.

    Args:
        frames: (*b, F).
        blocks: M.
        unknowns: q.
        like: of the type and device of the unknowns.
        energies: by name.
    """

    frames: torch.Size
    blocks: int
    unknowns: int
    like: Tensor
    energies: dict[str, Energy[Any]]

    @classmethod
    def of(cls, objective: Objective, state: State) -> SparseProblem:
        """What an objective and a state pose.

        Raises:
            InputError: the state has no blocks, or unknowns that frames share; an energy offers no
                ``linearize_blocks``, or couples frames.
        """
        if not isinstance(state, BlockState):
            raise InputError(
                f"state is a {type(state).__name__}, which has no block_dim; use "
                "LevenbergMarquardt for frames that are one block"
            )
        if state.shared_sizes:
            raise InputError(
                f"state has {sum(state.shared_sizes.values())} unknowns that frames share "
                f"({', '.join(state.shared_sizes)}), expected none: every "
                "frame is solved by itself; use LevenbergMarquardt"
            )
        for name, energy in objective.items():
            if not isinstance(energy, OffersBlocks) or energy.coupling is not Coupling.FRAME:
                raise InputError(
                    f"energy '{name}' ({type(energy).__name__}) offers no linearize_blocks for "
                    "single frames; give it one, or use LevenbergMarquardt"
                )
            require_weight(name, energy.weight, state.coordinates().frame.shape[:-2])
        frame, unknowns = state.coordinates().frame, state.block_dim
        blocks = state.frame_dim // unknowns
        return cls(frame.shape[:-1], blocks, unknowns, frame.new_empty(0), dict(objective.items()))

    def zeros(self, *more: int) -> Tensor:
        """Zeros (P, M, q, *more)."""
        return self.like.new_zeros(self.frames.numel(), self.blocks, self.unknowns, *more)

    def evaluate(self, state: State) -> dict[str, Tensor]:
        """Energies of each problem by name, (P,)."""
        return {
            name: self._costs(name, energy.residual(state).squared_norm())
            for name, energy in self.energies.items()
        }

    def linearize(self, state: State) -> SparseEquations:
        """Equations at a state."""
        gradient, diagonal = self.zeros(), self.zeros(self.unknowns)
        terms, curvatures = {}, []
        for name, energy in self.energies.items():
            linear = energy.linearize_blocks(state)  # type: ignore[operator]  # checked in ``of``
            if isinstance(linear, BlockLinearization):
                linear.require_fitting(name, self.frames, self.blocks, self.unknowns)
            squared = linear.residual.squared_norm()
            terms[name] = self._costs(name, squared)
            curvature = linear.curvature(_group_weight(energy, linear.residual, squared))
            curvature.add_equations(gradient, diagonal)
            curvatures.append(curvature)
        return SparseEquations(terms, total(terms), tuple(curvatures), gradient, diagonal)

    def coarse_space(self, state: State) -> CoarseSpace | None:
        """What the first energy that knows one offers, with modes (P, M, q, r), or None."""
        for energy in self.energies.values():
            if isinstance(energy, OffersCoarseSpace):
                space = energy.coarse_space(state)
                self._require_space(space)
                modes = space.modes.expand(*self.frames, *space.modes.shape[-3:])
                return CoarseSpace(space.group, space.groups, modes.flatten(0, -4).contiguous())
        return None

    def _require_space(self, space: CoarseSpace) -> None:
        lead = space.modes.shape[:-3] if fits(space.modes.shape[:-3], self.frames) else self.frames
        sizes = (*lead, self.blocks, self.unknowns, space.modes.shape[-1])
        require_shape(space.modes, "modes", sizes, "(*b, F, M, q, r) of the state's blocks")
        require_shape(space.group, "group", (self.blocks,), "(M,), of each block")
        if 0 in (space.groups, space.modes.shape[-1]) or space.group.is_floating_point():
            raise InputError(
                f"coarse space has {space.groups} groups, {space.modes.shape[-1]} modes and a "
                f"group of {space.group.dtype}; expected one or more, and integers"
            )
        if not is_plain(space.modes):
            return
        require_indices(space.group, "group", space.groups, "groups", least=-1)
        if not bool(space.modes.isfinite().all()):  # the search would end where it starts
            raise InputError("modes of a coarse space are not all finite; expected numbers")

    def _costs(self, name: str, squared: Tensor) -> Tensor:
        """``Energy.cost`` of every frame by itself, (P,); squared norms are (*b, F, G).

        Raises:
            InputError: they are of other frames, of which fewer would leave the rest unmoved.
        """
        if squared.shape[:-1] != self.frames:
            raise InputError(
                f"energy {name!r} has groups {tuple(squared.shape)} for a state of frames "
                f"{tuple(self.frames)}; expected values (*b, F, G, d) of each of them, and no "
                "confidences of more"
            )
        energy = self.energies[name]
        cost = energy.kernel.value(squared).sum(-1)
        return (energy.weight.to(cost)[..., None] * cost).expand(self.frames).reshape(-1)


def _group_weight(energy: Energy[Any], residual: Residual, squared: Tensor) -> Tensor:
    """Weight times confidence times slope of the kernel, (*b, F, G): reweighted least squares."""
    slope = energy.kernel.slope(squared)
    if residual.confidence is not None:
        slope = residual.confidence * slope
    return energy.weight.to(slope)[..., None, None] * slope
