"""Which joint angles people take together: a mixture of Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError


@dataclass(frozen=True)
class Mixture:
    """A mixture of K Gaussians over A angles.

    Attributes:
        names: of the angles, A.
        share: weight of each component, (K,), sums to one.
        mean: (K, A), radians.
        precision: lower Cholesky factors L of the inverse covariances L L', (K, A, A).
    """

    names: tuple[str, ...]
    share: Tensor
    mean: Tensor
    precision: Tensor

    def __post_init__(self) -> None:
        count, angles = self.mean.shape
        shapes = tuple(self.share.shape), tuple(self.precision.shape)
        if shapes != ((count,), (count, angles, angles)) or len(self.names) != angles:
            raise InputError(
                f"mixture has share and precision of shapes {shapes} and {len(self.names)} names; "
                f"expected {((count,), (count, angles, angles))} and {angles}"
            )
        if not bool((self.share > 0).all()) or abs(float(self.share.sum()) - 1) > 1e-3:
            raise InputError(f"mixture has shares {self.share.tolist()}; expected to sum to one")

    @property
    def surprise(self) -> Tensor:
        """Twice the negative log density of each mean, less the smallest of them, (K,)."""
        inner = self.precision.diagonal(dim1=-2, dim2=-1).log().sum(-1)
        each: Tensor = -2 * (self.share.log() + inner)
        return each - each.min()

    def ordered(self, names: tuple[str, ...]) -> Mixture:
        """The same over angles in another order.

        Raises:
            InputError: it knows other angles.
        """
        if sorted(names) != sorted(self.names):
            raise InputError(
                f"mixture knows angles {sorted(self.names)}; expected {sorted(names)}, those of "
                "the actor"
            )
        index = torch.tensor([self.names.index(name) for name in names])
        inverse = (self.precision @ self.precision.mT)[:, index][:, :, index]
        factors = torch.linalg.cholesky(inverse)
        return Mixture(names, self.share, self.mean[:, index], factors)
