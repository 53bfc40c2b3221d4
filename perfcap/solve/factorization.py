"""One factorization of the damped normal equations, for any number of right-hand sides.

Write J for the features of all window energies stacked, (E, D) a frame, A_f for the damped data
curvature, M_f = A_f + J_f' J_f, and U for the low rank that the temporal bases take away. Then
H = blockdiag(M) - U U', and by the Woodbury identity

    H^-1 = M^-1 + M^-1 U S^-1 U' M^-1,   S = I - U' M^-1 U.

The data may be a millionth of the prior, so S as written would lose most of its digits. Since
``B B'`` is the diagonal ``1 - (1 - keep)^2``, it equals

    S = diag((1 - keep)^2) (x) I + sum_f b_f b_f' (x) G_f,   G_f = I - J_f M_f^-1 J_f',

where nothing cancels if G_f is accurate. With Y = M^-1 J' it satisfies

    G = G^2 + Y' A Y,

because G J' = J' - J' J Y' ... = A Y transposed. Putting the difference ``I - J Y`` into the right
side squares its rounding error away in the directions where G is small, whatever the rank of J.

Shared unknowns border H and are eliminated by their Schur complement.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from perfcap.geometry.plain import is_plain
from perfcap.solve.frame_factors import factorize_frames, solve_frames
from perfcap.solve.layout import Layout
from perfcap.solve.normal_equations import NormalEquations
from perfcap.solve.products import apply, apply_transposed

if TYPE_CHECKING:
    from perfcap.solve._model_numba import Model


@dataclass(frozen=True)
class Factorization:
    """Solves with the damped matrix; all tensors are (B, ...).

    Args:
        layout: sizes of the unknowns.
        cholesky: lower factors of M_f, (B, F, D, D).
        window: the low-rank part, None without window energies.
        shared: the elimination of the shared unknowns, None where there are none.
        valid: whether the matrix of a batch element was positive definite, (B,).
    """

    layout: Layout
    cholesky: Tensor
    window: WindowPart | None
    shared: SharedPart | None
    valid: Tensor

    @cached_property
    def arrays(self) -> Model:
        """The same for compiled loops, without what belongs to shared unknowns."""
        from perfcap.solve._model_numba import Bases, as_arrays

        cholesky, window = self.cholesky, self.window
        if window is None:
            none = cholesky[..., :0]
            empty = none[..., :0, :]
            return as_arrays(cholesky, none, none.mT, empty, Bases((), []), none[:, 0, :0])
        bases, root = Bases(window.bases, window.sizes), window.cholesky.mT
        return as_arrays(cholesky, window.solved, window.jacobian, window.defect, bases, root)

    def solve(self, rows: Tensor) -> Tensor:
        """H^-1 times rows (B, N)."""
        frame, shared = self.layout.split(rows)
        solved = _solve_frames(self.cholesky, self.window, frame)
        return self._eliminate(solved, shared)

    def newton_step(self, equations: NormalEquations) -> Tensor:
        """``-H^-1 g`` for the gradient of the equations that were factorized, (B, N)."""
        if self.window is None:
            return -self.solve(equations.gradient())
        if self.shared is None and is_plain(self.cholesky, equations.frame_gradient):
            from perfcap.solve import _model_numba

            return _model_numba.newton_step(self.arrays, equations)
        data = equations.frame_gradient
        pulls = torch.cat([window.pull() for window in equations.windows], -1)  # B F E
        prior = apply_transposed(self.window.jacobian, pulls)  # B F D
        solved = solve_frames(self.cholesky, data)
        # U' M^-1 of the prior's gradient is taken as B y' - G y', exactly zero where B y' is
        features = apply(self.window.jacobian, solved) - apply(self.window.defect, pulls)
        in_basis = [window.pull_in_basis().flatten(1) for window in equations.windows]
        right = self.window.to_basis(features) + torch.cat(in_basis, -1)
        solved = solved + solve_frames(self.cholesky, prior) + self.window.correction(right)
        return -self._eliminate(solved, equations.shared_gradient)

    def frame_half(self, batch: Tensor, frame: Tensor, inner: Tensor) -> Tensor:
        """``L_f^-1 e`` for unit vectors e of the frames, M_f = L_f L_f': (B, m, D)."""
        factors = self.cholesky[batch, frame]  # B m D D
        unit = torch.nn.functional.one_hot(inner, self.layout.frame_dim).to(factors)
        half: Tensor = torch.linalg.solve_triangular(factors, unit.unsqueeze(-1), upper=False)
        return half.squeeze(-1)

    def _eliminate(self, solved: Tensor, shared: Tensor) -> Tensor:
        """Rows (B, N) from frames solved without their border (B, F, D)."""
        if self.shared is None:
            return solved.flatten(1)
        remaining = shared - apply_transposed(self.shared.border, solved).sum(1)
        own = _cholesky_solve(remaining, self.shared.cholesky)
        solved = solved - apply(self.shared.solved_border, own.unsqueeze(1))
        return torch.cat((solved.flatten(1), own), -1)


@dataclass(frozen=True)
class WindowPart:
    """The low-rank part of the window energies.

    Args:
        bases: B of each window energy, (K, F).
        sizes: features E of each.
        jacobian: stacked Jacobian J, (B, F, E, D).
        solved: Y = M^-1 J', (B, F, D, E).
        defect: G = I - J Y, (B, F, E, E).
        cholesky: lower factor of the capacitance matrix S, (B, sum K E, sum K E).
    """

    bases: tuple[Tensor, ...]
    sizes: list[int]
    jacobian: Tensor
    solved: Tensor
    defect: Tensor
    cholesky: Tensor

    def to_basis(self, features: Tensor) -> Tensor:
        """Stacked features (B, F, E) against the bases, (B, sum K E)."""
        parts = torch.split(features, self.sizes, -1)
        seen = [(b @ part).flatten(1) for b, part in zip(self.bases, parts, strict=True)]
        return torch.cat(seen, -1)

    def from_basis(self, components: Tensor) -> Tensor:
        """The transpose of ``to_basis``, (B, F, E)."""
        sizes = [len(b) * size for b, size in zip(self.bases, self.sizes, strict=True)]
        parts = torch.split(components, sizes, -1)
        features = [
            b.mT @ part.reshape(-1, len(b), size)
            for b, size, part in zip(self.bases, self.sizes, parts, strict=True)
        ]
        return torch.cat(features, -1)

    def correction(self, right: Tensor) -> Tensor:
        """``M^-1 U S^-1`` times vectors (B, sum K E), as frames (B, F, D)."""
        return apply(self.solved, self.from_basis(_cholesky_solve(right, self.cholesky)))

    def corrections(self, features: Tensor) -> Tensor:
        """``M^-1 U S^-1 U'`` of features of many columns, (B, F, E, S), as frames (B, F, D, S)."""
        batch, frames, size, columns = features.shape
        apart = features.movedim(-1, 1).reshape(-1, frames, size)  # BS F E
        right = self.to_basis(apart).reshape(batch, columns, -1).mT  # B R S
        spread = torch.cholesky_solve(right, self.cholesky).mT.flatten(0, 1)  # BS R
        back = self.from_basis(spread).reshape(batch, columns, frames, size).movedim(1, -1)
        corrections: Tensor = self.solved @ back  # B F D S
        return corrections

    def half_rows(self, batch: Tensor, frame: Tensor, inner: Tensor) -> Tensor:
        """``L^-1 U' M^-1 e`` for unit vectors e, with S = L L': (B, m, sum K E)."""
        features = torch.split(self.solved[batch, frame, inner], self.sizes, -1)  # B m E
        columns = [
            (b.mT[frame].unsqueeze(-1) * part.unsqueeze(-2)).flatten(2)  # B m K E
            for b, part in zip(self.bases, features, strict=True)
        ]
        stacked = torch.cat(columns, -1).mT
        half: Tensor = torch.linalg.solve_triangular(self.cholesky, stacked, upper=False)
        return half.mT


@dataclass(frozen=True)
class SharedPart:
    """Elimination of the shared unknowns.

    Args:
        border: cross curvature, (B, F, D, S).
        solved_border: frames' inverse times the border, (B, F, D, S).
        cholesky: lower factor of the Schur complement, (B, S, S).
    """

    border: Tensor
    solved_border: Tensor
    cholesky: Tensor

    def half_rows(self, batch: Tensor, index: Tensor) -> Tensor:
        """The Schur complement's share of H^-1 at unknowns (B, m), as a half, (B, m, S)."""
        own = -torch.eye(self.cholesky.shape[-1], device=index.device).to(self.cholesky)
        rows = torch.cat((self.solved_border.flatten(1, 2), own.expand_as(self.cholesky)), 1)
        right = rows[batch, index].mT
        half: Tensor = torch.linalg.solve_triangular(self.cholesky, right, upper=False)
        return half.mT


def factorize(equations: NormalEquations, damping: Tensor) -> Factorization:
    """Factorize the normal equations with ``damping`` (B, N) added to their diagonal.

    Elements whose matrix is not positive definite are marked, and solved as if it were the
    identity so that they stay finite.
    """
    frame_damping, shared_damping = equations.layout.split(damping)
    jacobian = _stacked_features(equations)
    cholesky, solved, defect, valid = factorize_frames(equations.curvature, frame_damping, jacobian)
    valid = valid.all(-1)
    window = shared = None
    if equations.windows:
        window, positive = _window_part(equations, jacobian, solved, defect)
        valid = valid & positive
    if equations.layout.shared_dim:
        shared, positive = _shared_part(equations, cholesky, window, shared_damping)
        valid = valid & positive
    return Factorization(equations.layout, cholesky, window, shared, valid)


def _stacked_features(equations: NormalEquations) -> Tensor:
    """Jacobians of all window energies, (B, F, E, D)."""
    if len(equations.windows) == 1:
        return equations.windows[0].jacobian
    none = equations.curvature[..., :0, :]
    return torch.cat([none, *(window.jacobian for window in equations.windows)], -2)


def _window_part(
    equations: NormalEquations, jacobian: Tensor, solved: Tensor, defect: Tensor
) -> tuple[WindowPart, Tensor]:
    """Low-rank part from what the frames give, and where it is positive definite."""
    sizes = [window.jacobian.shape[-2] for window in equations.windows]
    bases = tuple(window.basis for window in equations.windows)
    complements = [
        window.complement.repeat_interleave(size)
        for window, size in zip(equations.windows, sizes, strict=True)
    ]
    root, valid = _factorize_capacitance(bases, sizes, defect, torch.cat(complements))
    part = WindowPart(bases, sizes, jacobian, solved, defect, identity_where(~valid, root))
    return part, valid


def _factorize_capacitance(
    bases: tuple[Tensor, ...], sizes: list[int], defect: Tensor, seen: Tensor
) -> tuple[Tensor, Tensor]:
    """Lower factors of ``diag(seen) + sum_f b_f b_f' (x) G_f`` and whether there are, (B,)."""
    if is_plain(defect, seen, *bases):
        from perfcap.solve import _capacitance_numba

        return _capacitance_numba.factorize_capacitance(bases, sizes, defect, seen)
    capacitance = _capacitance(bases, sizes, defect)
    capacitance.diagonal(dim1=-2, dim2=-1).add_(seen)
    root, info = torch.linalg.cholesky_ex(capacitance)
    return root, info == 0


def _capacitance(bases: tuple[Tensor, ...], sizes: list[int], defect: Tensor) -> Tensor:
    """``sum_f b_f b_f' (x) G_f`` over all pairs of window energies, (B, sum K E, sum K E)."""
    batch, lengths = len(defect), [len(b) * size for b, size in zip(bases, sizes, strict=True)]
    result = defect.new_empty(batch, sum(lengths), sum(lengths))
    places = torch.split(result, lengths, 1), torch.split(defect, sizes, -2)
    for left, row, strip in zip(bases, *places, strict=True):
        parts = torch.split(row, lengths, 2), torch.split(strip, sizes, -1)
        for right, target, block in zip(bases, *parts, strict=True):
            pairs = (left.unsqueeze(1) * right.unsqueeze(0)).flatten(0, 1)  # KK F
            shape = (batch, len(left), len(right), *block.shape[-2:])
            summed = (pairs @ block.flatten(2)).reshape(shape).transpose(2, 3)  # B K E K E
            target.view(summed.shape).copy_(summed)  # straight into place: it may be megabytes
    return result


def _shared_part(
    equations: NormalEquations, cholesky: Tensor, window: WindowPart | None, damping: Tensor
) -> tuple[SharedPart, Tensor]:
    border = equations.border
    solved = torch.cholesky_solve(border, cholesky)  # B F D S
    if window is not None:
        solved = solved + window.corrections(window.jacobian @ solved)
    schur = equations.shared_curvature - border.flatten(1, 2).mT @ solved.flatten(1, 2)
    schur.diagonal(dim1=-2, dim2=-1).add_(damping)
    root, info = torch.linalg.cholesky_ex(schur)
    valid = (info == 0) & root.diagonal(dim1=-2, dim2=-1).isfinite().all(-1)
    return SharedPart(border, solved, identity_where(~valid, root)), valid


def _solve_frames(cholesky: Tensor, window: WindowPart | None, right: Tensor) -> Tensor:
    """The frames' part of H^-1 on frames (B, F, D)."""
    solved = solve_frames(cholesky, right)
    if window is None:
        return solved
    return solved + window.correction(window.to_basis(apply(window.jacobian, solved)))


def _cholesky_solve(right: Tensor, cholesky: Tensor) -> Tensor:
    """Solve for vectors (..., n) with lower factors (..., n, n)."""
    return torch.cholesky_solve(right.unsqueeze(-1), cholesky).squeeze(-1)


def identity_where(mask: Tensor, matrices: Tensor) -> Tensor:
    """Replace the matrices (B, ..., n, n) of masked batch elements by the identity."""
    if mask.is_cpu and not bool(mask.any()):
        return matrices  # a graphics card would have to be waited for
    identity = torch.eye(matrices.shape[-1], dtype=matrices.dtype, device=matrices.device)
    mask = mask.reshape(-1, *[1] * (matrices.ndim - 1))
    return torch.where(mask, identity, matrices)
