"""Memory that the steps of a solve share, for compiled loops on plain tensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.solve._capacitance_numba import place_pairs
from perfcap.solve._model_numba import Model, plain
from perfcap.solve.normal_equations import NormalEquations

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]


class Filter(NamedTuple):
    """The temporal filters of all window energies, their rows as those of ``Model.bases``."""

    bases: Floats  # C, one above the other, (K, F)
    keep: Floats  # (K,)
    complement: Floats  # (1 - keep)^2, (K,)


@dataclass(frozen=True)
class Room:
    """Memory that the steps of a solve share, and what stays the same in all of them.

    ``pairs`` (P, F) are products of two rows of the bases, ``places`` where their blocks lie in
    the capacitance matrix, and ``seen`` (R,) what is added to its diagonal.
    """

    filter: Filter
    bases: Floats
    start: Indices
    feature: Indices
    size: Indices
    pairs: Tensor
    places: tuple[Indices, Indices]
    seen: Floats
    cholesky: Floats
    solved: Floats
    defect: Tensor
    summed: Tensor
    upper: Tensor

    @classmethod
    def of(cls, equations: NormalEquations) -> Room:
        """Room for steps of equations of this shape, with these filters."""
        windows, curvature = equations.windows, equations.curvature
        batch, frames, dim, _ = curvature.shape
        sizes = [window.jacobian.shape[-2] for window in windows]
        lengths = [len(window.basis) for window in windows]
        size = np.repeat(np.array(sizes, np.int64), lengths)
        rows, features = int(size.sum()), sum(sizes)
        none = curvature.new_empty(0, frames)
        stacked = torch.cat([none, *(window.basis for window in windows)])
        plain_bases = torch.cat([none, *(window.plain_basis for window in windows)])
        keep = torch.cat([none[:, 0], *(window.keep for window in windows)])
        complement = torch.cat([none[:, 0], *(window.complement for window in windows)])
        left, right = torch.triu_indices(len(size), len(size))
        new = curvature.new_empty
        return cls(
            filter=Filter(plain(plain_bases), plain(keep), plain(complement)),
            bases=plain(stacked),
            start=np.cumsum(size) - size,
            feature=np.repeat(np.cumsum([0, *sizes], dtype=np.int64)[:-1], lengths),
            size=size,
            pairs=stacked[left] * stacked[right],
            places=(left.numpy(), right.numpy()),
            seen=np.repeat(plain(complement), size),
            cholesky=new(batch, frames, dim, dim).numpy(),
            solved=new(batch, frames, dim, features).numpy(),
            defect=new(batch, frames, features, features),
            summed=new(len(left), features * features),
            upper=curvature.new_zeros(batch, rows, rows),
        )

    def model(self, jacobian: Floats, root: Tensor) -> Model:
        """The factorization that lies here."""
        return Model(
            self.cholesky,
            self.solved,
            jacobian,
            self.defect.numpy(),
            self.bases,
            self.start,
            self.feature,
            self.size,
            plain(root.mT),
        )

    def factorize_capacitance(self) -> tuple[Tensor, Tensor]:
        """Lower factors and whether there are; see ``_capacitance_numba``."""
        features = self.defect.shape[-1]
        if not self.upper.shape[-1]:
            return self.upper, torch.ones(len(self.upper), dtype=torch.bool)
        places = *self.places, self.start, self.feature, self.size, self.seen
        for defect, upper in zip(self.defect, self.upper, strict=True):
            torch.mm(self.pairs, defect.flatten(1), out=self.summed)
            summed = self.summed.numpy().reshape(-1, features, features)
            place_pairs(summed, *places, upper.numpy())
        root, info = torch.linalg.cholesky_ex(self.upper.mT)
        return root, info == 0
