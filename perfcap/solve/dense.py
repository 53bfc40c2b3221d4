"""Plain nonlinear least squares: a vector of unknowns and any residual function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

from torch import Tensor

from perfcap.solve.energy import Energy, Residual, State, Step
from perfcap.solve.kernels import Kernel


@dataclass(frozen=True)
class Vector:
    """A vector of unknowns (*b, n): one frame of n unknowns."""

    values: Tensor

    @property
    def frame_dim(self) -> int:
        """The length n."""
        return self.values.shape[-1]

    @property
    def shared_dim(self) -> int:
        """Nothing is shared."""
        return 0

    def retract(self, step: Step) -> Vector:
        """Add."""
        return Vector(self.values + step.frame.squeeze(-2))

    def local(self, other: Vector) -> Step:
        """Subtract."""
        return self._step(other.values - self.values)

    def coordinates(self) -> Step:
        """The unknowns themselves."""
        return self._step(self.values)

    def _step(self, values: Tensor) -> Step:
        return Step(values.unsqueeze(-2), values.new_zeros(*values.shape[:-1], 0))


class ResidualFunction(Energy[Vector]):
    """The sum of squares of a function of a ``Vector``, ``weight * sum kernel(r_i^2)``.

    Args:
        function: unknowns (*b, n) to residuals (*b, m), each batch element on its own.
        weight: of the sum.
        kernel: acts on each residual by itself.

    Example:
        >>> rosenbrock = ResidualFunction(
        ...     lambda x: torch.stack((10 * (x[..., 1] - x[..., 0] ** 2), 1 - x[..., 0]), -1)
        ... )
        >>> start = Vector(torch.tensor([-1.2, 1.0], dtype=torch.float64))
        >>> solve(Objective(rosenbrock=rosenbrock), start).state.values
        tensor([1., 1.], dtype=torch.float64)
    """

    def __init__(
        self,
        function: Callable[[Tensor], Tensor],
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
    ) -> None:
        super().__init__(weight, kernel)
        self.function = function

    def residual(self, state: State) -> Residual:
        """Each residual is a group of its own, (*b, 1, m, 1)."""
        values = self.function(cast(Vector, state).values)
        return Residual(values.unsqueeze(-2).unsqueeze(-1))
