"""States made of named states over the same frames, and energies that see one of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.solve.blocks import add_sparse, sparse_gradient
from perfcap.solve.energy import (
    Coupling,
    Energy,
    Linearization,
    OffersBlocks,
    Residual,
    Step,
    WindowEnergy,
)
from perfcap.solve.second_order import SecondOrder, second_order
from perfcap.solve.sparse import OffersBlocks as OffersSparse
from perfcap.solve.stationarity import energy_gradient


@dataclass(frozen=True)
class Compound:
    """Named states of the same frames as one: a motion and a deformation, say.

    The tangent vector of a frame is that of the first part, of the second, ...; shared blocks
    follow one another likewise.

    Attributes:
        parts: states (*b, F) by name; names of their shared blocks differ.
    """

    parts: Mapping[str, Any]

    def __post_init__(self) -> None:
        leads = {tuple(part.coordinates().frame.shape[:-1]) for part in self.parts.values()}
        if len(leads) != 1:
            raise InputError(
                f"parts {', '.join(self.parts)} have batches and frames {sorted(leads)}; give one "
                "state or more, all of the same frames"
            )
        names = [name for part in self.parts.values() for name in part.shared_sizes]
        if len(names) != len(set(names)):
            raise InputError(
                f"parts share blocks {', '.join(names)}; expected a name of its own for each"
            )

    def __getitem__(self, index: slice | Tensor) -> Self:
        """Select along the frame axis."""
        return type(self)({name: part[index] for name, part in self.parts.items()})

    @property
    def frame_dim(self) -> int:
        """D, of all parts."""
        return sum(part.frame_dim for part in self.parts.values())

    @property
    def shared_sizes(self) -> dict[str, int]:
        """Of all parts, in their order."""
        return {n: size for part in self.parts.values() for n, size in part.shared_sizes.items()}

    def columns(self, name: str) -> slice:
        """Where a part's unknowns are among the D of a frame.

        Raises:
            InputError: there is no such part.
        """
        start = 0
        for own, part in self.parts.items():
            if own == name:
                return slice(start, start + part.frame_dim)
            start += part.frame_dim
        raise InputError(f"state has parts {', '.join(self.parts)}; expected {name!r} among them")

    def retract(self, step: Step) -> Self:
        """Move every part along its share of a tangent vector."""
        frames = torch.split(step.frame, [p.frame_dim for p in self.parts.values()], -1)
        sizes = [sum(p.shared_sizes.values()) for p in self.parts.values()]
        steps = zip(frames, torch.split(step.shared, sizes, -1), strict=True)
        moved = zip(self.parts.items(), steps, strict=True)
        return type(self)({name: part.retract(Step(*each)) for (name, part), each in moved})

    def local(self, other: Self) -> Step:
        """Tangent vector from here to another state with the same parts."""
        return _joined([p.local(other.parts[name]) for name, p in self.parts.items()])

    def coordinates(self) -> Step:
        """Those of all parts."""
        return _joined([part.coordinates() for part in self.parts.values()])


def _joined(steps: list[Step]) -> Step:
    frame = torch.cat([step.frame for step in steps], -1)
    return Step(frame, torch.cat([step.shared for step in steps], -1))


def of_part(name: str, energy: Energy[Any]) -> Energy[Compound]:
    """An energy of one part of a ``Compound``, as an energy of the whole.

    Closed derivatives, compiled blocks and second derivatives are those of the energy; one that
    offers ``linearize_blocks`` alone adds its few blocks to the normal equations.

    Args:
        name: of the part.
        energy: of a state such as that part.
    """
    if isinstance(energy, WindowEnergy):
        return WindowOfPart(name, energy)
    return OfPart(name, energy)


class OfPart(Energy[Compound]):
    """See ``of_part``."""

    coupling = Coupling.FRAME

    def __init__(self, name: str, energy: Energy[Any]) -> None:
        super().__init__(energy.weight, energy.kernel)
        self.name, self.energy, self.sees = name, energy, energy.sees

    def residual(self, state: Compound) -> Residual:
        """That of the energy, (*b, F, G, d)."""
        return self.energy.residual(state.parts[self.name])

    def linearize(self, state: Compound) -> Linearization:
        """Zero in the unknowns of other parts."""
        linear = self.energy.linearize(state.parts[self.name])
        frame = _padded(linear.frame, state, self.name)
        return Linearization(linear.residual, frame, linear.shared, linear.value)

    def add_to_blocks(self, state: Compound, curvature: Tensor, gradient: Tensor) -> Tensor | None:
        """Those of the energy, or of the few blocks that its groups see; see ``OffersBlocks``."""
        own = state.columns(self.name)
        part = state.parts[self.name]
        dim = part.frame_dim
        blocks = curvature.new_zeros(*curvature.shape[:-2], dim, dim)
        slope = gradient.new_zeros(*gradient.shape[:-1], dim)
        value = None
        if isinstance(self.energy, OffersBlocks):
            value = self.energy.add_to_blocks(part, blocks, slope)
        elif isinstance(self.energy, OffersSparse):
            value = add_sparse(self.energy, part, blocks, slope)
        if value is not None:
            curvature[..., own, own] += blocks
            gradient[..., own] += slope
        return value

    def gradient(self, state: Compound) -> tuple[Tensor, Tensor | None]:
        """Half the energy's own, (*b, F, D) and (*b, S'), differentiable in all that it holds."""
        part = state.parts[self.name]
        if isinstance(self.energy, OffersSparse) and not hasattr(self.energy, "gradient"):
            frame, shared = sparse_gradient(self.energy, part), None
        else:
            frame, shared = energy_gradient(self.energy, part)
        return _padded(frame, state, self.name), shared

    def second_order(self, state: Compound, pull: Tensor) -> SecondOrder | None:
        """The energy's own."""
        return _padded_blocks(
            second_order(self.energy, state.parts[self.name], pull), state, self.name
        )


class WindowOfPart(WindowEnergy[Compound]):
    """See ``of_part``."""

    def __init__(self, name: str, energy: WindowEnergy[Any]) -> None:
        super().__init__(energy.basis, energy.keep, energy.weight)
        self.name, self.energy, self.sees = name, energy, energy.sees

    def features(self, state: Compound) -> Tensor:
        """Those of the energy, (*b, F, E)."""
        return self.energy.features(state.parts[self.name])

    def linearize_features(self, state: Compound) -> tuple[Tensor, Tensor]:
        """Zero in the unknowns of other parts."""
        features, jacobian = self.energy.linearize_features(state.parts[self.name])
        return features, _padded(jacobian, state, self.name)

    def second_order(self, state: Compound, pull: Tensor) -> SecondOrder | None:
        """The energy's own."""
        return _padded_blocks(
            second_order(self.energy, state.parts[self.name], pull), state, self.name
        )


def _padded(derivative: Tensor, state: Compound, name: str) -> Tensor:
    """A derivative (..., d) in one part's unknowns, zero in all others, (..., D)."""
    own = state.columns(name)
    return torch.nn.functional.pad(derivative, (own.start, state.frame_dim - own.stop))


def _padded_blocks(found: SecondOrder | None, state: Compound, name: str) -> SecondOrder | None:
    if found is None:
        return None
    own = state.columns(name)
    rows = (own.start, state.frame_dim - own.stop)
    frame = torch.nn.functional.pad(found.frame, (*rows, *rows))
    if found.border is None:
        return SecondOrder(frame)
    border = torch.nn.functional.pad(found.border, (0, 0, *rows))
    return SecondOrder(frame, border, found.shared)
