"""Plain nonlinear least squares: a vector of unknowns and any residual function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.solve.bounds import Bounds
from perfcap.solve.energy import Energy, Objective, Residual, State, Step
from perfcap.solve.kernels import Kernel
from perfcap.solve.soundness import require_recording

_CHANGES = 1e-3  # of residuals, a unit of the unknown: rounding changes them by far less

Function = Callable[[Tensor], Tensor]
Sides = tuple[Tensor | float | None, Tensor | float | None]


@dataclass(frozen=True)
class Vector:
    """A vector of unknowns (*b, n): one frame of n unknowns."""

    values: Tensor

    @property
    def frame_dim(self) -> int:
        """The length n."""
        return self.values.shape[-1]

    @property
    def shared_sizes(self) -> dict[str, int]:
        """Nothing is shared."""
        return {}

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
        self, function: Function, weight: float | Tensor = 1.0, kernel: Kernel | None = None
    ) -> None:
        super().__init__(weight, kernel)
        self.function = function

    def residual(self, state: State) -> Residual:
        """Each residual is a group of its own, (*b, 1, m, 1).

        Raises:
            InputError: the function returned something else than rows of residuals.
        """
        unknowns = cast(Vector, state).values
        values = self.function(unknowns)
        _require_rows(values, unknowns)
        return Residual(values.unsqueeze(-2).unsqueeze(-1))


def _require_rows(values: object, unknowns: Tensor) -> None:
    if not isinstance(values, Tensor):
        raise InputError(
            f"the residual function returned a {type(values).__name__}, expected a tensor of "
            "residuals (*b, m); use torch operations, so that it can be differentiated"
        )
    if values.ndim != unknowns.ndim or values.shape[:-1] != unknowns.shape[:-1]:
        raise InputError(
            f"the residual function returned shape {tuple(values.shape)} for unknowns "
            f"{tuple(unknowns.shape)}, expected (*b, m): a row of residuals for a row of unknowns"
        )
    if not values.shape[-1]:
        raise InputError(
            "the residual function returned no residuals, so that nothing is asked; expected "
            "(*b, m) of one or more"
        )
    if values.dtype != unknowns.dtype:
        raise InputError(
            f"the residual function returned {values.dtype} for unknowns of {unknowns.dtype}; "
            "make its constants the type of the unknowns"
        )


def pose(function: Function, initial: object, bounds: object) -> tuple[Objective, Vector, Any]:
    """The objective, state and bounds that a bare function and tensors stand for.

    Raises:
        InputError: unknowns that are no floating-point vector, bounds that do not fit them, or a
            function that cannot be differentiated.
    """
    if not isinstance(initial, Tensor) or not initial.is_floating_point() or not initial.ndim:
        kind = f" {initial.dtype} {tuple(initial.shape)}" if isinstance(initial, Tensor) else ""
        raise InputError(
            f"initial is a {type(initial).__name__}{kind}, expected a floating-point tensor (n,), "
            "or (*b, n) for a batch, beside a function; any other state goes with an Objective"
        )
    if torch._C._functorch.maybe_current_level() is not None:
        raise InputError(
            "solve cannot run inside of torch.func.vmap, grad or jvp; give a batch (*b, n) "
            "instead, and take gradients by backward() with adjoint=Implicit()"
        )
    require_recording()
    own = ResidualFunction(function)
    with torch.enable_grad():
        asked = initial.detach().clone().requires_grad_()
        depends = own.residual(Vector(asked)).value.requires_grad
    if not depends:
        raise InputError(
            "the residual function does not depend on its unknowns by torch operations: no "
            "derivative leads through detach(), item(), numpy() or torch.no_grad(); leave them out"
        )
    _require_slopes(own, initial.detach())
    return Objective(function=own), Vector(initial), _box(bounds, initial)


def _require_slopes(function: ResidualFunction, start: Tensor) -> None:
    """Refuse a function that changes with unknowns (*b, n) whose derivative is zero all around.

    They would stay where they start, as if they were the answer.

    Raises:
        InputError: it does.
    """
    here, values = _slopes(function, start)
    still = (here == 0).reshape(-1, start.shape[-1]).all(0)
    if not bool(still.any() and values.isfinite().all()):
        return
    size = torch.finfo(start.dtype).eps ** (1 / 3)
    step = still * size * start.abs().clamp(min=1)
    (left, below), (right, above) = (_slopes(function, start + sign * step) for sign in (-1, 1))
    # what is even about the start, as a square at zero, has no slope there
    change = float((above - below).abs().max()) / (2 * size)
    flat = not bool((left[..., still] != 0).any() or (right[..., still] != 0).any())
    if flat and change > _CHANGES * max(1.0, float(values.abs().max())):
        raise InputError(
            f"the residual function changes with unknowns {still.nonzero().flatten().tolist()}, "
            "but no derivative leads to them by torch operations, so that they would stay where "
            "they start: torch.tensor([...]) of unknowns, float(), item(), math and NumPy cut it; "
            "use torch.stack and torch functions"
        )


def _slopes(function: ResidualFunction, unknowns: Tensor) -> tuple[Tensor, Tensor]:
    """Derivative (*b, n) of a sum of residuals that no two of cancel in, and the residuals."""
    with torch.enable_grad():
        asked = unknowns.clone().requires_grad_()
        values = function.residual(Vector(asked)).value
        odd = (1.0 + torch.arange(values.numel()).to(values)).sin().reshape(values.shape)
        (slope,) = torch.autograd.grad((values * odd).sum(), asked)
    return slope, values.detach()


def _box(bounds: object, initial: Tensor) -> Bounds | None:
    if bounds is None:
        return None
    if not isinstance(bounds, (tuple, list)) or len(bounds) != 2:
        raise InputError(
            f"bounds are a {type(bounds).__name__}, expected a pair (lower, upper) of tensors "
            "(n,), numbers, or None where a side is free"
        )
    return Bounds.on_frames(
        _side(bounds[0], -torch.inf, "lower", initial),
        _side(bounds[1], torch.inf, "upper", initial),
    )


def _side(given: Any, free: float, name: str, initial: Tensor) -> Tensor:
    try:
        side = torch.as_tensor(free if given is None else given, device=initial.device)
        precise = side if side.dtype == torch.float64 else side.to(initial.dtype)
        return precise.expand(initial.shape).unsqueeze(-2)
    except (RuntimeError, TypeError, ValueError) as error:
        raise InputError(
            f"the {name} bound is a {type(given).__name__} that does not broadcast to the unknowns "
            f"{tuple(initial.shape)}; expected a number, a tensor (n,), or None where it is free"
        ) from error
