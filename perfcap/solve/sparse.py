"""What energies of many unknowns a frame offer: each group of residuals sees a few blocks of them.

A frame of such a state is M blocks of q unknowns, and a problem of its own. ``P`` counts problems:
the frames of all batch elements. Vectors over the unknowns are (P, M, q).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor

from perfcap.array_checks import require_indices
from perfcap.errors import InputError
from perfcap.geometry.plain import is_plain
from perfcap.solve.coarse_space import CoarseSpace
from perfcap.solve.energy import Residual
from perfcap.solve.energy_checks import fits


class Curvature(Protocol):
    """``J' W J`` of one energy at a state: what conjugate gradients need to know of it.

    Every method adds to a tensor in place: the sums over energies run hundreds of times a solve.
    """

    def add_equations(self, gradient: Tensor, diagonal: Tensor) -> None:
        """Add ``J' W r`` to (P, M, q), blocks on the diagonal of ``J' W J`` to (P, M, q, q).

        Of the blocks, the lower triangles. They scale and precondition: where a group names a
        block twice, what is across may be left out.
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


@runtime_checkable
class OffersCoarseSpace(Protocol):
    """An energy that knows motions it hardly resists; purely a matter of speed."""

    def coarse_space(self, state: Any) -> CoarseSpace:
        """Such motions at a state."""


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

    def require_fitting(self, name: str, frames: Sequence[int], blocks: int, unknowns: int) -> None:
        """Refuse what is not of a state's blocks of unknowns: compiled loops believe it.

        Args:
            name: of the energy.
            frames: (*b, F); fewer would leave the rest unmoved.
            blocks: M.
            unknowns: q.

        Raises:
            InputError: it is not.
        """
        *groups, entries = self.residual.value.shape
        slots = self.blocks.shape[-1]
        own, wanted = tuple(self.jacobian.shape), (*groups, slots, entries, unknowns)
        named = fits(self.blocks.shape, (*groups, slots))
        whole = self.blocks.dtype in (torch.int64, torch.int32)
        if own != wanted or not named or not whole or tuple(groups[:-1]) != tuple(frames):
            raise InputError(
                f"energy {name!r} has a derivative {own} of values "
                f"{tuple(self.residual.value.shape)} in blocks {tuple(self.blocks.shape)}; "
                f"expected (*b, F, G, k, d, q) with (*b, F) = {tuple(frames)} and q = {unknowns}, "
                "(*b, F, G, d), and integers (*b, F, G, k)"
            )
        if is_plain(self.jacobian):
            require_indices(self.blocks, f"energy {name!r}", blocks, "blocks", least=-1)

    def curvature(self, weight: Tensor) -> Curvature:
        """``J' W J`` with the weight (*b, F, G) of each group."""
        lead = self.jacobian.shape[:-2]  # *b F G k
        parts = (
            self.blocks.expand(lead).flatten(0, -3),
            self.jacobian.flatten(0, -5),
            self.residual.value.flatten(0, -3),
            weight.expand(lead[:-1]).flatten(0, -2),
        )
        if is_plain(self.jacobian):
            from perfcap.solve._blocks_numba import BlockCurvature

            return BlockCurvature.of(*parts)
        from perfcap.solve._blocks_torch import BlockCurvature as Plain

        return Plain(*parts)
