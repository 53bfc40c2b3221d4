"""From energies to normal equations: linearise each one and add up its blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from perfcap.array_checks import require_shape
from perfcap.errors import InputError
from perfcap.geometry.plain import is_plain
from perfcap.solve.energy import (
    Coupling,
    Energy,
    Linearization,
    Objective,
    OffersBlocks,
    State,
    WindowEnergy,
)
from perfcap.solve.energy_checks import (
    require_features,
    require_lead,
    require_linearization,
    require_slopes,
    require_types,
    require_value,
    require_weight,
)
from perfcap.solve.layout import Layout
from perfcap.solve.normal_equations import NormalEquations, WindowTerm
from perfcap.solve.products import apply_transposed

# --- Residual rows added to the blocks of normal equations ----------------------------------------


def add_rows(
    jacobian: Tensor, residual: Tensor, weight: Tensor, curvature: Tensor, gradient: Tensor
) -> None:
    """Add ``J' W J`` and ``J' W r`` of every frame, in place.

    Args:
        jacobian: J, (B, F, G, d, D).
        residual: r, (B, F, G, d).
        weight: diagonal of W, the same for the d entries of a group, (B, F, G).
        curvature: what to add to, (B, F, D, D), contiguous.
        gradient: the same, (B, F, D).
    """
    if is_plain(jacobian, residual, weight, curvature, gradient):
        from perfcap.solve import _rows_numba

        return _rows_numba.add_rows(jacobian, residual, weight, curvature, gradient)
    rows, weights = jacobian.flatten(2, 3), weight.unsqueeze(-1).expand_as(residual).flatten(2)
    curvature += (weights.unsqueeze(-1) * rows).mT @ rows
    gradient += apply_transposed(rows, weights * residual.flatten(2))
    return None


# --- From energies to normal equations: linearise each one and add up its blocks ------------------


def assemble(objective: Objective, state: State) -> NormalEquations:
    """Linearise every energy at a state and add up the structured normal equations.

    Raises:
        InputError: an energy couples frames but is no ``WindowEnergy``, or sees shared unknowns
            through a window.
    """
    layout = Layout.of(state)
    like = state.coordinates().frame
    blocks = _Blocks.zeros(layout, like)
    terms: dict[str, Tensor] = {}
    windows: list[WindowTerm] = []
    for name, energy in objective.items():
        require_weight(name, energy.weight, layout.batch)
        if isinstance(energy, WindowEnergy):
            _require_frames_only(name, energy)
            windows.append(_window_term(energy, state, layout))
            terms[name] = windows[-1].value()
        elif energy.coupling is Coupling.FRAME:
            terms[name] = blocks.add_energy(energy, state, layout)
        else:
            raise InputError(
                f"energy '{name}' ({type(energy).__name__}) has WINDOW coupling but is not a "
                "WindowEnergy; derive it from WindowEnergy so that its structure is known"
            )
    return blocks.equations(layout, terms, windows)


def _require_frames_only(name: str, energy: WindowEnergy[Any]) -> None:
    if energy.sees:
        raise InputError(
            f"energy '{name}' ({type(energy).__name__}) sees shared unknowns through a window; "
            "window energies see frames only, so express it by features of the frames"
        )


def _window_term(energy: WindowEnergy[Any], state: State, layout: Layout) -> WindowTerm:
    features, jacobian = energy.linearize_features(state)
    require_features(energy, features, jacobian, layout.batch, (layout.frames, layout.frame_dim))
    like = state.coordinates().frame
    require_types(energy, "linearize_features", like, features, jacobian)
    weight = _weight(energy, layout, features).sqrt()
    complement = (1 - energy.keep).square()
    return WindowTerm(
        basis=(1 - complement).clamp(min=0).sqrt()[:, None] * energy.basis,
        complement=complement,
        plain_basis=energy.basis,
        keep=energy.keep,
        features=weight[..., None, None] * layout.per_element(features),
        jacobian=weight[..., None, None, None] * layout.per_element(jacobian),
    )


def _weight(energy: Energy[Any], layout: Layout, like: Tensor) -> Tensor:
    """Weight of an energy in the precision of its rows: (B,), or (1,) when all share it."""
    weight = energy.weight.to(like)
    return layout.per_element(weight) if weight.ndim else weight.reshape(1)


@dataclass
class _Blocks:
    """Running sums of the FRAME energies; the only mutable thing of the assembly."""

    curvature: Tensor
    gradient: Tensor
    border: Tensor
    shared_curvature: Tensor
    shared_gradient: Tensor

    @classmethod
    def zeros(cls, layout: Layout, like: Tensor) -> _Blocks:
        batch, frames = layout.batch_size, layout.frames
        dim, shared = layout.frame_dim, layout.shared_dim
        return cls(
            like.new_zeros(batch, frames, dim, dim),
            like.new_zeros(batch, frames, dim),
            like.new_zeros(batch, frames, dim, shared),
            like.new_zeros(batch, shared, shared),
            like.new_zeros(batch, shared),
        )

    def equations(
        self, layout: Layout, terms: dict[str, Tensor], windows: list[WindowTerm]
    ) -> NormalEquations:
        return NormalEquations(
            layout=layout,
            terms=terms,
            curvature=self.curvature,
            frame_gradient=self.gradient,
            border=self.border,
            shared_curvature=self.shared_curvature,
            shared_gradient=self.shared_gradient,
            windows=tuple(windows),
        )

    def add_energy(self, energy: Energy[Any], state: State, layout: Layout) -> Tensor:
        """Add a FRAME energy and return its value, (B,)."""
        if isinstance(energy, OffersBlocks):
            added = energy.add_to_blocks(state, self.curvature, self.gradient)
            if added is not None:
                if not isinstance(added, Tensor):
                    raise InputError(
                        f"{type(energy).__name__}.add_to_blocks returned a "
                        f"{type(added).__name__}; expected the energy of each batch element, (B,)"
                    )
                what = "(B,), the energy of each batch element"
                require_shape(
                    added, f"{type(energy).__name__}.add_to_blocks", (len(self.gradient),), what
                )
                return added
        linear = energy.linearize(state)
        require_linearization(energy, linear)
        require_lead(energy, linear.residual.value, layout.batch, layout.frames)
        require_slopes(energy, linear.frame, linear.residual.value, layout.frame_dim)
        require_types(energy, "linearize", self.gradient, linear.residual.value, linear.frame)
        value = energy.cost(linear.residual) if linear.value is None else linear.value
        require_value(energy, value, layout.batch)
        self.add(energy, linear, layout)
        return layout.per_element(value)

    def add(self, energy: Energy[Any], linear: Linearization, layout: Layout) -> None:
        """Add ``w J' diag(confidence * slope) (J, r)`` of one energy (reweighted least squares)."""
        jacobian = layout.per_element(linear.frame)  # B F G d D
        residual = layout.per_element(linear.residual.value)  # B F G d
        weight = _row_weight(energy, linear, layout)  # B F G
        add_rows(jacobian, residual, weight, self.curvature, self.gradient)
        if linear.shared is not None:
            seen = layout.seen(energy.sees)
            shared = layout.per_element(linear.shared).flatten(2, 3)  # B F Gd S'
            weights = weight.unsqueeze(-1).expand_as(residual).flatten(2)
            weighted = weights.unsqueeze(-1) * shared
            self.border[..., seen] += jacobian.flatten(2, 3).mT @ weighted
            curvature = shared.flatten(1, 2).mT @ weighted.flatten(1, 2)
            add_block(self.shared_curvature, seen, curvature)
            gradient = apply_transposed(weighted, residual.flatten(2)).sum(1)
            self.shared_gradient[..., seen] += gradient


def add_block(matrix: Tensor, index: slice | list[int], block: Tensor) -> None:
    """Add to rows and columns of a matrix (..., S, S), in place."""
    if isinstance(index, slice):
        matrix[..., index, index] += block
        return
    rows = torch.tensor(index, device=matrix.device)
    matrix[..., rows[:, None], rows] += block


def _row_weight(energy: Energy[Any], linear: Linearization, layout: Layout) -> Tensor:
    """Weight times confidence times kernel slope of each group, (B, F, G)."""
    residual = linear.residual
    slope = energy.kernel.slope(residual.squared_norm())
    if residual.confidence is not None:
        slope = residual.confidence * slope
    weight = _weight(energy, layout, slope)[:, None, None]
    return weight * layout.per_element(slope)
