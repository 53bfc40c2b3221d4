"""Points that depend linearly on a few coefficients of shape."""

from __future__ import annotations

from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from perfcap.errors import InputError

Floats = NDArray[np.float64]


class ShapeSpace(nn.Module):
    """Points ``mean + sum_s shape_s * deviation_s * basis_s``.

    A coefficient of one is one standard deviation of the population the basis was made from.

    Args:
        mean: (N, 3), metres.
        basis: (S, N, 3), metres where ``deviation`` is left out.
        deviation: standard deviation of each component, (S,); ones if not given.
    """

    mean: Tensor
    basis: Tensor

    def __init__(self, mean: Tensor, basis: Tensor, deviation: Tensor | None = None) -> None:
        super().__init__()
        if mean.ndim != 2 or mean.shape[-1] != 3 or basis.shape[1:] != mean.shape:
            raise InputError(
                f"shape space has mean {tuple(mean.shape)} and basis {tuple(basis.shape)}; "
                "expected (N, 3) and (S, N, 3)"
            )
        if deviation is not None:
            if deviation.shape != basis.shape[:1] or not bool((deviation > 0).all()):
                raise InputError(
                    f"shape space has deviations {tuple(deviation.shape)} for {len(basis)} "
                    "components; expected one positive number each"
                )
            basis = basis * deviation.to(basis)[:, None, None]
        self.register_buffer("mean", mean)
        self.register_buffer("basis", basis.to(mean))

    @classmethod
    def from_samples(cls, samples: Floats, components: int) -> Self:
        """Principal components of point sets in correspondence, (K, N, 3), largest first."""
        count = len(samples)
        if not 0 < components < count:
            raise InputError(f"{components} components of {count} samples; give more samples")
        mean = samples.mean(0)
        rows = (samples - mean).reshape(count, -1)
        # the Gram matrix is K x K, however many points there are
        values, vectors = np.linalg.eigh(rows @ rows.T / (count - 1))
        order = np.argsort(-values)[:components]
        axes = vectors[:, order].T @ rows / np.sqrt(count - 1)
        axes *= np.sign(axes[np.arange(components), np.abs(axes).argmax(1)])[:, None]
        return cls(torch.tensor(mean), torch.tensor(axes.reshape(components, *mean.shape)))

    @property
    def components(self) -> int:
        """S."""
        return len(self.basis)

    def forward(self, shape: Tensor) -> Tensor:
        """Points (*b, N, 3) of coefficients (*b, S); fewer than S leave the rest at zero."""
        count = shape.shape[-1]
        if count > self.components:
            raise InputError(f"shape has {count} coefficients; this space has {self.components}")
        moved: Tensor = self.mean + torch.einsum("...s,snk->...nk", shape, self.basis[:count])
        return moved

    def coefficients(self, points: Tensor, ridge: float = 1e-6) -> Tensor:
        """Least-squares coefficients (*b, S) of points (*b, N, 3), in the same place and pose.

        Args:
            points: metres.
            ridge: pull of each coefficient towards zero, against metres squared.
        """
        rows = self.basis.flatten(1)
        gram = rows @ rows.mT + ridge * torch.eye(self.components).to(rows)
        right = (points - self.mean).flatten(-2) @ rows.mT
        solved: Tensor = torch.linalg.solve(gram, right.unsqueeze(-1)).squeeze(-1)
        return solved
