"""The quadratic model of an objective at a state, kept in its structure.

With y_f the features of a window energy, J_f their Jacobian and B = diag(sqrt(1 - (1 - keep)^2)) C
its scaled temporal basis, the Gauss-Newton matrix is

    H = blockdiag(A_f) + sum over window energies of  w J' (I - B'B) J,

bordered by the shared unknowns. A_f is D x D and comes from the FRAME energies; H is never formed.
All derivatives leave out the factor 2 of a sum of squares: near the state the energy is
``E + 2 g.d + d.H d``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.solve.energy import total
from perfcap.solve.layout import Layout
from perfcap.solve.products import apply, apply_transposed


@dataclass(frozen=True)
class WindowTerm:
    """A window energy at a state; the weight is inside, as its square root.

    Args:
        basis: B, the basis scaled by ``sqrt(1 - (1 - keep)^2)``, (K, F).
        complement: ``(1 - keep)^2``, what the energy still sees of each row of the basis, (K,).
        plain_basis: C, (K, F), with ``keep`` (K,): the filter is ``I - C' diag(keep) C``.
        keep: see ``plain_basis``.
        features: weighted features y, (B, F, E).
        jacobian: weighted Jacobian J of the features, (B, F, E, D).
    """

    basis: Tensor
    complement: Tensor
    plain_basis: Tensor
    keep: Tensor
    features: Tensor
    jacobian: Tensor

    def filter(self, features: Tensor) -> Tensor:
        """``(I - C' diag(keep) C) y``, (B, F, E)."""
        kept = self.keep[:, None] * (self.plain_basis @ features)
        return features - self.plain_basis.mT @ kept

    def pull(self) -> Tensor:
        """``(I - B'B) y``, the filter applied twice: features' share of the gradient, (B, F, E)."""
        return self.features - self.basis.mT @ (self.basis @ self.features)

    def pull_in_basis(self) -> Tensor:
        """``B (I - B'B) y`` without rounding where it is zero, (B, K, E).

        For rows with keep = 1 it vanishes analytically. Computed from ``pull`` it would be
        rounding noise, which the capacitance matrix magnifies by the prior-to-data ratio.
        """
        return self.complement[:, None] * (self.basis @ self.features)

    def value(self) -> Tensor:
        """Energy, (B,)."""
        return self.filter(self.features).square().sum((-2, -1))


@dataclass(frozen=True)
class NormalEquations:
    """Gradient and Gauss-Newton matrix of an objective at a state, with its energies.

    Args:
        layout: sizes of the unknowns.
        terms: value of each energy by name, (B,).
        curvature: A_f of the FRAME energies, (B, F, D, D).
        frame_gradient: their gradient, (B, F, D).
        border: cross curvature of frames and shared unknowns, (B, F, D, S).
        shared_curvature: (B, S, S).
        shared_gradient: (B, S).
        windows: the window energies.
    """

    layout: Layout
    terms: dict[str, Tensor]
    curvature: Tensor
    frame_gradient: Tensor
    border: Tensor
    shared_curvature: Tensor
    shared_gradient: Tensor
    windows: tuple[WindowTerm, ...]

    @property
    def energy(self) -> Tensor:
        """Total energy, (B,)."""
        return total(self.terms)

    def gradient(self) -> Tensor:
        """Half the gradient of the energy, (B, N)."""
        frame = self.frame_gradient
        for window in self.windows:
            frame = frame + apply_transposed(window.jacobian, window.pull())
        return self.join(frame, self.shared_gradient)

    def join(self, frame: Tensor, shared: Tensor) -> Tensor:
        """Rows (B, N) from frames (B, F, D) and shared unknowns (B, S)."""
        flat = frame.flatten(1)
        return torch.cat((flat, shared), -1) if self.layout.shared_dim else flat

    def decrease(self, step: Tensor) -> Tensor:
        """What the quadratic model promises of a step (B, N): E(here) - model(step), (B,).

        Window energies are compared through their filtered residual: the difference of the two
        large numbers J'J and J'B'BJ never appears.
        """
        frame, shared = self.layout.split(step)
        gradient, curved = self.frame_gradient, apply(self.curvature, frame)
        if self.layout.shared_dim:
            curved = curved + 2 * apply(self.border, shared.unsqueeze(1))
        change = (frame * (2 * gradient + curved)).sum((-2, -1))
        for window in self.windows:
            moved = window.filter(apply(window.jacobian, frame))
            residual = window.filter(window.features)
            change = change + (moved * (2 * residual + moved)).sum((-2, -1))
        if self.layout.shared_dim:
            curved = apply(self.shared_curvature, shared)
            change = change + (shared * (2 * self.shared_gradient + curved)).sum(-1)
        return -change

    def apply(self, step: Tensor) -> Tensor:
        """H times rows (B, N)."""
        frame, shared = self.layout.split(step)
        result = apply(self.curvature, frame)
        for window in self.windows:
            twice = window.filter(window.filter(apply(window.jacobian, frame)))
            result = result + apply_transposed(window.jacobian, twice)
        if not self.layout.shared_dim:
            return result.flatten(1)
        result = result + apply(self.border, shared.unsqueeze(1))
        border = apply_transposed(self.border, frame).sum(1)
        return self.join(result, border + apply(self.shared_curvature, shared))

    def data_diagonal(self) -> tuple[Tensor, Tensor]:
        """Diagonal of the curvature that FRAME energies give, (B, F, D) and (B, S)."""
        frame = self.curvature.diagonal(dim1=-2, dim2=-1)
        return frame, self.shared_curvature.diagonal(dim1=-2, dim2=-1)

    def finite(self) -> Tensor:
        """Whether everything about a batch element is finite, (B,)."""
        total = self.energy + self.curvature.sum((-3, -2, -1)) + self.frame_gradient.sum((-2, -1))
        for window in self.windows:
            total = total + window.jacobian.sum((-3, -2, -1))
        if self.layout.shared_dim:
            total = total + self.border.sum((-3, -2, -1)) + self.shared_curvature.sum((-2, -1))
            total = total + self.shared_gradient.sum(-1)
        return total.isfinite()

    def where(self, mask: Tensor, other: NormalEquations) -> NormalEquations:
        """These for the batch elements of a mask (B,), the other ones' for the rest."""
        if bool(mask.all()):
            return self

        def pick(own: Tensor, others: Tensor) -> Tensor:
            return torch.where(mask.reshape(-1, *[1] * (own.ndim - 1)), own, others)

        return self._map(pick, other)

    def detach(self) -> NormalEquations:
        """The same numbers without a graph."""
        return self._map(torch.Tensor.detach)

    def zeros(self) -> NormalEquations:
        """Equations of the same shape that know nothing: a stand-in for what is not finite."""
        return self._map(torch.zeros_like)

    def _map(self, function: Callable[..., Tensor], *others: NormalEquations) -> NormalEquations:
        """A function of every batched tensor, and of its fellows in other equations."""

        def mapped(name: str) -> Tensor:
            return function(*(getattr(each, name) for each in (self, *others)))

        return replace(
            self,
            terms={
                name: function(value, *(other.terms[name] for other in others))
                for name, value in self.terms.items()
            },
            windows=tuple(
                replace(
                    own,
                    features=function(own.features, *(window.features for window in rest)),
                    jacobian=function(own.jacobian, *(window.jacobian for window in rest)),
                )
                for own, *rest in zip(
                    self.windows, *(other.windows for other in others), strict=True
                )
            ),
            curvature=mapped("curvature"),
            frame_gradient=mapped("frame_gradient"),
            border=mapped("border"),
            shared_curvature=mapped("shared_curvature"),
            shared_gradient=mapped("shared_gradient"),
        )
