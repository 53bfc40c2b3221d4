"""States, residuals, energies and their sum: the vocabulary of the solver.

Shapes: ``*b`` is any batch (windows, people), ``F`` frames, ``G`` residual groups a frame, ``d``
entries a group, ``D`` unknowns a frame, ``S`` unknowns shared by all frames of a batch element.
"""

from __future__ import annotations

import enum
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, Protocol, Self, TypeVar, runtime_checkable

import torch
from torch import Tensor, nn

from perfcap.errors import InputError
from perfcap.solve.energy_checks import require_filtered, require_fitting, require_settings
from perfcap.solve.kernels import Kernel, Quadratic


class Coupling(enum.Enum):
    """Which frames a residual row depends on."""

    FRAME = "frame"  # row f sees frame f (and the shared unknowns) only
    WINDOW = "window"  # rows see all frames, through a linear filter along time


@dataclass(frozen=True)
class Step:
    """A tangent vector of a state: ``frame`` (*b, F, D) and ``shared`` (*b, S)."""

    frame: Tensor
    shared: Tensor


class State(Protocol):
    """Unknowns of a solve: an immutable value on a manifold."""

    @property
    def frame_dim(self) -> int:
        """D, tangent dimensions of a frame."""

    @property
    def shared_sizes(self) -> Mapping[str, int]:
        """Tangent dimensions of what all frames share, S in all: named blocks in their order."""

    def retract(self, step: Step) -> Self:
        """Move along a tangent vector; a zero step is the identity."""

    def local(self, other: Self) -> Step:
        """Tangent vector from here to ``other``: the inverse of ``retract``."""

    def coordinates(self) -> Step:
        """The numbers that box bounds apply to, in the order of the tangent vector.

        Only coordinates that ``retract`` adds to may be bounded; others may hold anything. A state
        may name others by an attribute ``curved``, a slice of D: bounds on these are refused.
        """


StateType = TypeVar("StateType", bound=State)


@dataclass(frozen=True)
class Residual:
    """Residual groups ``value`` (*b, F, G, d) and their ``confidence`` (*b, F, G), 1 if None."""

    value: Tensor
    confidence: Tensor | None = None

    def squared_norm(self) -> Tensor:
        """Confidence times squared norm of each group, (*b, F, G)."""
        return self._squared_norm

    @cached_property
    def _squared_norm(self) -> Tensor:
        """Kept, since a linearization asks for it twice."""
        # a sum over so short an axis takes three times as long
        squared = torch.einsum("...d,...d->...", self.value, self.value)
        return squared if self.confidence is None else self.confidence * squared


@dataclass(frozen=True)
class Linearization:
    """A residual and its derivative.

    ``frame`` is (*b, F, G, d, D), the derivative of frame f's rows in frame f's unknowns;
    ``shared`` is (*b, F, G, d, S'), in the shared blocks that the energy sees and the state has, in
    the state's order, or None where there are none. ``value`` (*b,) is the weighted energy where it
    is not the cost of the residual.
    """

    residual: Residual
    frame: Tensor
    shared: Tensor | None = None
    value: Tensor | None = None


class Energy(nn.Module, ABC, Generic[StateType]):
    """A weighted sum of robust squared residuals: ``weight * sum kernel(confidence * |group|^2)``.

    There is no hidden one half. An author names the kind of state, as in ``Energy[Motion]``, and
    writes ``residual``; ``linearize`` may be overridden by a closed form, and is forward-mode
    differentiation otherwise. ``sees`` names the shared blocks that the residual depends on, where
    a state has them.
    """

    coupling = Coupling.FRAME
    sees: Collection[str] = ()
    weight: Tensor

    def __init__(self, weight: float | Tensor = 1.0, kernel: Kernel | None = None) -> None:
        super().__init__()
        require_settings(weight, kernel)
        if isinstance(weight, nn.Parameter):
            self.weight = weight
        elif isinstance(weight, Tensor):
            self.register_buffer("weight", weight)
        else:
            # what a Python float is; the cost casts it to the residual's precision
            self.register_buffer("weight", torch.tensor(float(weight), dtype=torch.float64))
        self.kernel = kernel if kernel is not None else Quadratic()

    @abstractmethod
    def residual(self, state: StateType) -> Residual:
        """Residual groups at a state, (*b, F, G, d)."""

    def forward(self, state: StateType) -> Tensor:
        """Energy of each batch element, (*b,): an ordinary differentiable loss."""
        return self.cost(self.residual(state))

    def cost(self, residual: Residual) -> Tensor:
        """Energy of a residual that is already at hand, (*b,)."""
        require_fitting(self, residual.value, residual.confidence)
        cost = self.kernel.value(residual.squared_norm()).sum((-2, -1))
        return self.weight.to(cost) * cost

    def per_frame(self, state: StateType) -> Tensor:
        """The energy of each frame, (*b, F); they sum to it."""
        each = self.kernel.value(self.residual(state).squared_norm()).sum(-1)
        weight = self.weight.to(each)
        return (weight[..., None] if weight.ndim else weight) * each

    def linearize(self, state: StateType) -> Linearization:
        """Residual and Jacobian at a state."""
        return forward_mode(self, state)


@runtime_checkable
class OffersBlocks(Protocol):
    """An energy that adds to normal equations without its Jacobian, where it can."""

    def add_to_blocks(self, state: Any, curvature: Tensor, gradient: Tensor) -> Tensor | None:
        """Add what ``linearize`` says to blocks (B, F, D, D) and (B, F, D), in place.

        Returns:
            The energy of each batch element, (B,); None, with nothing added, where the rows of
            ``linearize`` have to be used: shared unknowns, gradients, another device.
        """


class WindowEnergy(Energy[StateType]):
    """An energy that filters per-frame features along time, ``y - C' diag(keep) C y``.

    ``features`` (*b, F, E) may be any function of a frame's unknowns. ``basis`` C (K, F) has
    orthonormal rows and ``keep`` (K,) in [0, 1] says how much of each row's component is left
    unpenalised: 1 removes it from the residual, 0 penalises it fully. The energy is
    ``weight * |y - C' diag(keep) C y|^2``, always with the quadratic kernel, so its curvature
    in time is ``I - C' diag(1 - (1 - keep)^2) C``: a multiple of the identity minus a low rank.
    """

    coupling = Coupling.WINDOW
    basis: Tensor
    keep: Tensor

    def __init__(self, basis: Tensor, keep: Tensor, weight: float | Tensor = 1.0) -> None:
        super().__init__(weight)
        _require_filter(basis, keep)
        self.register_buffer("basis", basis)
        self.register_buffer("keep", keep)

    def linearize(self, state: StateType) -> Linearization:
        """A window energy has no blocks of its residual, which sees all frames.

        Raises:
            TypeError: always; ``linearize_features`` is what the solver uses.
        """
        raise TypeError(f"{type(self).__name__} couples frames; use linearize_features")

    @abstractmethod
    def features(self, state: StateType) -> Tensor:
        """Per-frame features y, (*b, F, E)."""

    def linearize_features(self, state: StateType) -> tuple[Tensor, Tensor]:
        """Features (*b, F, E) and their Jacobian (*b, F, E, D)."""
        jacobian, features, _ = _diagonal_blocks(lambda at: (self.features(at), None), state)
        return features, jacobian[..., : state.frame_dim]

    def filter(self, features: Tensor) -> Tensor:
        """Apply the temporal filter to features (*b, F, E)."""
        require_filtered(self, features, self.basis)
        components = self.basis @ features  # *b K E
        return features - self.basis.mT @ (self.keep[:, None] * components)

    def residual(self, state: StateType) -> Residual:
        """Filtered features, one group a frame: (*b, F, 1, E)."""
        return Residual(self.filter(self.features(state)).unsqueeze(-2))


def _require_filter(basis: Tensor, keep: Tensor) -> None:
    """Raise an InputError unless the basis has orthonormal rows and keep fits it."""
    if basis.ndim != 2 or keep.shape != basis.shape[:1]:
        raise InputError(
            f"window energy has basis {tuple(basis.shape)} and keep {tuple(keep.shape)}, "
            "expected (K, F) and (K,)"
        )
    error = (basis @ basis.mT - torch.eye(len(basis)).to(basis)).abs()
    if not bool((error < 1e-4).all()):
        raise InputError(
            f"window energy has a basis whose rows are off orthonormal by "
            f"{float(error.max()):.2g}; orthonormalise it, the solver relies on it"
        )
    if not bool(((keep >= 0) & (keep <= 1)).all()):
        raise InputError(f"window energy has keep {keep.tolist()}, expected values in [0, 1]")


def forward_mode(energy: Energy[StateType], state: StateType) -> Linearization:
    """Linearization of a FRAME energy by forward-mode differentiation of its residual.

    The confidence is held constant, as the kernels' slopes are: a least-squares method does not
    differentiate its weights.
    """

    def value_and_confidence(at: StateType) -> tuple[Tensor, Tensor | None]:
        residual = energy.residual(at)
        return residual.value, residual.confidence

    jacobian, value, confidence = _diagonal_blocks(value_and_confidence, state)
    return Linearization(
        Residual(value, confidence),
        jacobian[..., : state.frame_dim],
        seen_part(jacobian[..., state.frame_dim :], state.shared_sizes, energy.sees),
    )


def seen_columns(sizes: Mapping[str, int], names: Collection[str]) -> slice | list[int]:
    """Which shared unknowns the named blocks are: a slice where they lie side by side."""
    columns: list[int] = []
    start = 0
    for name, size in sizes.items():
        columns += range(start, start + size) if name in names else ()
        start += size
    if not columns:
        return slice(0, 0)
    side_by_side = columns[-1] - columns[0] + 1 == len(columns)
    return slice(columns[0], columns[-1] + 1) if side_by_side else columns


def seen_part(
    derivative: Tensor, sizes: Mapping[str, int], names: Collection[str]
) -> Tensor | None:
    """The columns of named blocks of a derivative (..., S) in all that is shared; None if none."""
    part = derivative[..., seen_columns(sizes, names)]
    return part if part.shape[-1] else None


def _diagonal_blocks(
    function: Callable[[StateType], tuple[Tensor, Tensor | None]], state: StateType
) -> tuple[Tensor, Tensor, Tensor | None]:
    """Derivative (..., D + S) of rows that each see one frame, their value, and a constant.

    Rows of frame f depend on frame f only, so one tangent vector shared by all frames and batch
    elements returns every diagonal block in D (+ S) columns instead of D * F.
    """
    here = state.coordinates()
    zero = here.frame.new_zeros(state.frame_dim + here.shared.shape[-1])

    def moved(tangent: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
        frame = tangent[: state.frame_dim].expand_as(here.frame)
        shared = tangent[state.frame_dim :].expand_as(here.shared)
        value, constant = function(state.retract(Step(frame, shared)))
        return value, (value,) if constant is None else (value, constant)

    jacobian, (value, *constant) = torch.func.jacfwd(moved, has_aux=True)(zero)
    return jacobian, value, constant[0] if constant else None


class Objective(nn.Module):
    """Named energies and their sum."""

    def __init__(
        self, energies: Mapping[str, Energy[Any]] | None = None, **named: Energy[Any]
    ) -> None:
        super().__init__()
        given = [*(energies or {}).items(), *named.items()]
        for name, energy in given:
            _require_named(name, energy)
        if len(dict(given)) < len(given):
            raise InputError(f"an Objective got a name twice: {[name for name, _ in given]}")
        self.energies = nn.ModuleDict(dict(given))
        if not self.energies:
            raise InputError("an Objective needs at least one energy, got none; pass it by name")

    def items(self) -> list[tuple[str, Energy[Any]]]:
        """Names and energies in the order given."""
        return list(self.energies.items())  # type: ignore[arg-type]

    def forward(self, state: State) -> Tensor:
        """Total energy of each batch element, (*b,)."""
        return total(self.report(state))

    def report(self, state: State) -> dict[str, Tensor]:
        """Each energy's share, (*b,) by name."""
        return {name: energy(state) for name, energy in self.items()}


def _require_named(name: str, energy: object) -> None:
    if not isinstance(energy, Energy):
        raise InputError(
            f"{name!r} is a {type(energy).__name__}, expected an Energy; ResidualFunction makes "
            "one of a function from a vector to residuals"
        )
    if not name or "." in name or hasattr(nn.ModuleDict, name):
        raise InputError(f"{name!r} cannot name an energy; expected a plain word")


def total(terms: Mapping[str, Tensor]) -> Tensor:
    """Sum of energies by name, (*b,)."""
    return torch.stack(list(terms.values())).sum(0)
