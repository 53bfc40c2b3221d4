"""Robust kernels: functions of the squared residual s, with value 0 and slope 1 at s = 0."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.setting_checks import require_size


class Kernel(ABC):
    """Maps a squared residual norm s >= 0 to a robust cost; acts elementwise."""

    @abstractmethod
    def value(self, squared: Tensor) -> Tensor:
        """Cost rho(s), the shape of ``squared``."""

    @abstractmethod
    def slope(self, squared: Tensor) -> Tensor:
        """First derivative rho'(s): the weight of a row in iteratively reweighted least squares."""


@dataclass(frozen=True)
class Quadratic(Kernel):
    """rho(s) = s."""

    def value(self, squared: Tensor) -> Tensor:  # noqa: D102
        return squared

    def slope(self, squared: Tensor) -> Tensor:  # noqa: D102
        return torch.ones_like(squared)


@dataclass(frozen=True)
class Huber(Kernel):
    """rho(s) = s up to ``scale``^2, then 2 scale sqrt(s) - scale^2 (Huber 1964).

    ``scale`` is in the unit of the residual.
    """

    scale: float

    def __post_init__(self) -> None:
        _require_scale(self)

    def value(self, squared: Tensor) -> Tensor:  # noqa: D102
        limit = self.scale**2
        # the clamp keeps the square root's derivative finite at zero, in the branch not taken
        linear = 2 * self.scale * squared.clamp(min=limit).sqrt() - limit
        return torch.where(squared <= limit, squared, linear)

    def slope(self, squared: Tensor) -> Tensor:  # noqa: D102
        return self.scale / squared.clamp(min=self.scale**2).sqrt()


@dataclass(frozen=True)
class GemanMcClure(Kernel):
    """rho(s) = s / (1 + s / scale^2), never above ``scale``^2 (Geman and McClure 1987).

    ``scale`` is in the unit of the residual: the residual at which the pull is a quarter of the
    quadratic one.
    """

    scale: float

    def __post_init__(self) -> None:
        _require_scale(self)

    def value(self, squared: Tensor) -> Tensor:  # noqa: D102
        return squared / (1 + squared / self.scale**2)

    def slope(self, squared: Tensor) -> Tensor:  # noqa: D102
        return (1 + squared / self.scale**2).square().reciprocal()


def _require_scale(kernel: Huber | GemanMcClure) -> None:
    """A tensor is left to torch, as one that is learned."""
    if not isinstance(kernel.scale, Tensor):
        require_size(kernel.scale, f"scale of {type(kernel).__name__}", finite=True)
