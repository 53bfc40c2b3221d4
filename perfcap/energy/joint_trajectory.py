"""Paths of points over a window as a few cosines whose coefficients are unknown (MuVS Eq. 8)."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import Points
from perfcap.energy._arguments import require_unit, seen_by
from perfcap.energy._point_curvature import point_curvature
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual, seen_columns
from perfcap.solve.kernels import Kernel
from perfcap.solve.second_order import SecondOrder
from perfcap.temporal.subspace import dct_basis

TRAJECTORY = "trajectory"
"""Shared: coefficients of the paths of N points in K cosines, K N 3 of them, metres."""


class JointTrajectory(Energy[Motion]):
    """Distance of points from smooth paths that are solved for, (x_f - B_f' c) / unit.

    A group is one point in one frame, so that a robust kernel lets single frames leave the path
    (Huang et al. 2017, Eq. 8): a leg exchanged for two frames does not bend it. With the quadratic
    kernel and the best c this is the part of the points outside the subspace, as a ``WindowEnergy``
    has it. The coefficients c are a motion's shared block ``"trajectory"``; see ``started``.

    Args:
        points: N points of the person.
        frames: F of the window.
        rank: K, cosines that are kept.
        weight: of the energy.
        kernel: acts on the squared distance, in ``unit``.
        unit: metres that count as one.

    Raises:
        InputError: a rank that is not 1 to F.
    """

    coupling = Coupling.FRAME
    basis: Tensor

    def __init__(
        self,
        points: Points,
        frames: int,
        rank: int = 10,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float = 1.0,
    ) -> None:
        super().__init__(weight, kernel)
        require_unit(unit)
        self.points, self.sees = points, (*seen_by(points), TRAJECTORY)
        self.scale = 1 / unit
        self.register_buffer("basis", dct_basis(frames, rank, dtype=torch.float64))

    def started(self, motion: Motion) -> Motion:
        """The motion (*b, F) with the coefficients of its own paths as the block."""
        plain = replace(motion, shared={k: v for k, v in motion.shared.items() if k != TRAJECTORY})
        paths = self.points(plain).flatten(-2)  # *b F 3N
        own = (self.basis.to(paths) @ paths).flatten(-2)
        return replace(plain, shared={**plain.shared, TRAJECTORY: own})

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, N, 3)."""
        return Residual(self.scale * (self.points(motion) - self._paths(motion)))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form; the paths are linear in what is shared."""
        points, frame, shared = self.points.linearize(motion)
        residual = Residual(self.scale * (points - self._paths(motion)))
        sizes = motion.shared_sizes
        own = [name for name in sizes if name in self.points.sees]
        parts = {TRAJECTORY: self._columns(points)}
        if shared is not None:
            split = torch.split(self.scale * shared, [sizes[name] for name in own], -1)
            parts |= dict(zip(own, split, strict=True))
        columns = torch.cat([parts[name] for name in sizes if name in parts], -1)
        return Linearization(residual, self.scale * frame, columns)

    def second_order(self, motion: Motion, pull: Tensor) -> SecondOrder:
        """Closed form: that of the points; the paths are linear in what is shared."""
        linearized = self.points.linearize(motion)
        bent = point_curvature(self.points, motion, linearized, self.scale * pull)
        if bent.border is None or bent.shared is None:
            return bent
        sizes = {name: size for name, size in motion.shared_sizes.items() if name in self.sees}
        place = seen_columns(sizes, self.points.sees)
        total = sum(sizes.values())
        border = bent.border.new_zeros(*bent.border.shape[:-1], total)
        border[..., place] = bent.border
        shared = bent.shared.new_zeros(*bent.shared.shape[:-2], total, total)
        part = shared[..., place].clone()
        part[..., place, :] = bent.shared
        shared[..., place] = part
        return SecondOrder(bent.frame, border, shared)

    def _paths(self, motion: Motion) -> Tensor:
        """(*b, F, N, 3)."""
        if TRAJECTORY not in motion.shared:
            raise ValueError("JointTrajectory needs a motion that shares trajectory; see started")
        own = motion.shared[TRAJECTORY]
        basis = self.basis.to(own)
        coefficients = own.reshape(*own.shape[:-1], len(basis), -1)  # *b K 3N
        paths = basis.mT @ coefficients
        return paths.reshape(*paths.shape[:-1], -1, 3)

    def _columns(self, points: Tensor) -> Tensor:
        """Derivative (*b, F, N, 3, K N 3) of the residual in the coefficients."""
        frames, count = points.shape[-3:-1]
        each = torch.eye(3 * count).to(points)
        basis = self.basis.to(points)
        columns = -self.scale * torch.einsum("kf,ij->fikj", basis, each)
        columns = columns.reshape(frames, count, 3, -1)
        return columns.expand(*points.shape[:-3], *columns.shape)
