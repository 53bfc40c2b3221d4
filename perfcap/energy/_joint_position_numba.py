"""Residuals of 3D joints and their derivatives as compiled loops, for plain tensors on the CPU.

Says the same as ``JointPosition`` in torch, which tests hold it equal to.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import inner, kernel
from perfcap.solve._robust_numba import Robust, robust

Floats = NDArray[np.floating[Any]]


class Known(NamedTuple):
    """What a ``JointPosition`` of N frames knows, and the length below which bones have none."""

    direction: Floats  # (N, C, J, 3)
    bones: Floats  # (J, J)
    chain: Floats  # (J, J)
    share: Floats  # (J,)
    scale: Floats  # (J,)
    shortest: float

    @classmethod
    def of(
        cls, direction: Tensor, constants: tuple[Tensor, Tensor, Tensor, Tensor], shortest: float
    ) -> Known:
        """From directions (*b, F, C, J, 3) and what does not depend on frames."""
        bones, chain, share, scale = (each.numpy() for each in constants)
        rows = _rows(direction, *direction.shape[-3:])
        return cls(rows, bones, chain, share, scale, shortest)


def residual(known: Known, joints: Tensor) -> Tensor:
    """(*b, F, C * J, 3) of joints (*b, F, J, 3)."""
    *lead, count, _ = joints.shape
    views = known.direction.shape[1]
    error = joints.new_empty(*lead, views * count, 3)
    _residual(known, _rows(joints, count, 3), error.numpy().reshape(-1, views, count, 3, 1))
    return error


def derivative(known: Known, joints: Tensor, jacobian: Tensor) -> Tensor:
    """(*b, F, C * J, 3, D) from that of the joints, (*b, F, J, 3, D)."""
    *lead, count, _, dim = jacobian.shape
    views = known.direction.shape[1]
    moved = joints.new_empty(*lead, views * count, 3, dim)
    _derivative(
        known,
        _rows(joints, count, 3),
        _rows(jacobian, count, 3, dim),
        moved.numpy().reshape(-1, views, count, 3, dim),
    )
    return moved


def add_to_blocks(
    known: Known,
    strength: tuple[Tensor, Tensor],
    joints: Tensor,
    jacobian: Tensor,
    kernel: Robust,
    blocks: tuple[Tensor, Tensor],
) -> Tensor:
    """Add to curvature and gradient; the energy of each batch element, (B,).

    Args:
        known: of the energy.
        strength: confidence (*b, F, C * J) and weight of the energy.
        joints: (*b, F, J, 3).
        jacobian: their derivative, (*b, F, J, 3, D), of which the first three columns are the
            translation of all joints, which this energy does not see.
        kernel: of the energy.
        blocks: curvature (B, F, D, D) and gradient (B, F, D).
    """
    (curvature, gradient), (confidence, weight) = blocks, strength
    (batch, _, dim), count = gradient.shape, joints.shape[-2]
    value = gradient.new_zeros(batch)
    error = residual(known, joints)
    _add_to_blocks(
        known,
        _rows(joints, count, 3),
        _rows(jacobian, count, 3, dim),
        _rows(error, known.direction.shape[1], count, 3),
        _rows(confidence, known.direction.shape[1], count),
        _rows(weight.to(gradient).expand(joints.shape[:-3])),
        kernel,
        curvature.numpy().reshape(-1, dim, dim),
        gradient.numpy().reshape(-1, dim),
        value.numpy(),
    )
    return value


def _rows(tensor: Tensor, *shape: int) -> Floats:
    """Contiguous, as another memory layout would compile the kernels once more."""
    return np.ascontiguousarray(tensor.detach().numpy()).reshape(-1, *shape)


@inner()
def _bone(known: Known, joints: Floats, bone: int) -> tuple[float, float, float, float]:
    """Vector of a bone and its length."""
    x, y, z = 0.0, 0.0, 0.0
    for j in range(len(joints)):
        share = known.bones[bone, j]
        if share != 0:
            x += share * joints[j, 0]
            y += share * joints[j, 1]
            z += share * joints[j, 2]
    return x, y, z, np.sqrt(x * x + y * y + z * z)


@kernel()
def _residual(known: Known, joints: Floats, error: Floats) -> None:
    """Joints (N, J, 3) minus predictions, centred, in their units: (N, C, J, 3, 1)."""
    length = np.empty((joints.shape[1], 1), joints.dtype)
    for n in range(len(joints)):
        for bone in range(len(length)):
            length[bone, 0] = _bone(known, joints[n], bone)[3]
        for view in range(error.shape[1]):
            for j in range(len(length)):
                for i in range(3):
                    error[n, view, j, i, 0] = joints[n, j, i]
            _subtract_predictions(known, known.direction[n, view], length, error[n, view])


@kernel()
def _derivative(known: Known, joints: Floats, jacobian: Floats, moved: Floats) -> None:
    """The same, (N, C, J, 3, D), of the derivative of joints (N, J, 3, D)."""
    longer = np.empty((jacobian.shape[1], jacobian.shape[3]), jacobian.dtype)
    for n in range(len(joints)):
        _lengthen(known, joints[n], jacobian[n], longer)
        for view in range(moved.shape[1]):
            for j in range(len(longer)):
                for i in range(3):
                    for k in range(longer.shape[1]):
                        moved[n, view, j, i, k] = jacobian[n, j, i, k]
            _subtract_predictions(known, known.direction[n, view], longer, moved[n, view])


@inner(fastmath={"contract"})
def _subtract_predictions(known: Known, direction: Floats, length: Floats, moved: Floats) -> None:
    """Subtract bones of lengths (J, D) along directions (J, 3) from joints (J, 3, D), and centre.

    The innermost loops run along rows of contiguous memory, which vectorises.
    """
    count, dim = length.shape
    mean = np.empty(dim, length.dtype)
    for i in range(3):
        for k in range(dim):
            mean[k] = 0
        for j in range(count):
            for bone in range(count):
                along = known.chain[j, bone] * direction[bone, i]
                if along != 0:
                    for k in range(dim):
                        moved[j, i, k] -= along * length[bone, k]
            for k in range(dim):
                mean[k] += known.share[j] * moved[j, i, k]
        for j in range(count):
            for k in range(dim):
                moved[j, i, k] = known.scale[j] * (moved[j, i, k] - mean[k])


@inner(fastmath={"contract"})
def _lengthen(known: Known, joints: Floats, jacobian: Floats, longer: Floats) -> None:
    """Derivative (J, D) of the lengths of bones; a bone of no length has none."""
    for bone in range(len(longer)):
        for k in range(longer.shape[1]):
            longer[bone, k] = 0
        x, y, z, length = _bone(known, joints, bone)
        for j in range(len(joints)):
            share = known.bones[bone, j] / max(length, known.shortest)
            if share != 0:
                for k in range(longer.shape[1]):
                    longer[bone, k] += share * (
                        x * jacobian[j, 0, k] + y * jacobian[j, 1, k] + z * jacobian[j, 2, k]
                    )


@kernel()
def _add_to_blocks(
    known: Known,
    joints: Floats,
    jacobian: Floats,
    error: Floats,
    confidence: Floats,
    weight: Floats,
    kernel: Robust,
    curvature: Floats,
    gradient: Floats,
    value: Floats,
) -> None:
    """All frames; with u_j a joint minus its prediction, residuals are ``s_j (u_j - mean u)``."""
    frames = len(joints) // len(weight)
    count, dim = jacobian.shape[1], jacobian.shape[3]
    longer = np.empty((count, dim), jacobian.dtype)
    moved = np.empty((count, 3, dim), jacobian.dtype)
    strength = np.empty(count, jacobian.dtype)
    for n in range(len(joints)):
        share, cost = weight[n // frames], 0.0
        _lengthen(known, joints[n], jacobian[n], longer)
        for view in range(error.shape[1]):
            at_all = False
            for j in range(count):
                own, trust = error[n, view, j], confidence[n, view, j]
                squared = trust * (own[0] * own[0] + own[1] * own[1] + own[2] * own[2])
                price, slope = robust(kernel, squared)
                cost += price
                strength[j] = share * trust * slope
                at_all = at_all or strength[j] != 0
            if at_all:
                _move(known, known.direction[n, view], longer, jacobian[n], moved)
                _add_view(known, moved, error[n, view], strength, curvature[n], gradient[n])
        value[n // frames] += share * cost


@inner(fastmath={"contract"})
def _move(known: Known, direction: Floats, longer: Floats, jacobian: Floats, moved: Floats) -> None:
    """Derivative of u, (J, 3, D); bones whose length changes by rounding alone are rigid."""
    count, _, dim = jacobian.shape
    for j in range(count):
        for i in range(3):
            for k in range(dim):
                moved[j, i, k] = 0 if k < 3 else jacobian[j, i, k]
    for bone in range(count):
        if _stretches(longer[bone]):
            for j in range(count):
                for i in range(3):
                    along = known.chain[j, bone] * direction[bone, i]
                    for k in range(3, dim if along != 0 else 3):
                        moved[j, i, k] -= along * longer[bone, k]


@inner()
def _stretches(longer: Floats) -> bool:
    """Whether a bone's length changes by more than rounding."""
    return bool(np.max(np.abs(longer[3:])) > 64 * np.finfo(longer.dtype).eps)


@inner(fastmath={"contract"})
def _add_view(
    known: Known,
    moved: Floats,
    error: Floats,
    strength: Floats,
    curvature: Floats,
    gradient: Floats,
) -> None:
    """Add ``sum_j w_j s_j^2 (du_j - m)' (du_j - m)`` with m the mean of du, and the gradient."""
    count, _, dim = moved.shape
    mean, heavy = np.empty(dim, moved.dtype), np.empty(dim, moved.dtype)
    for i in range(3):
        whole, drawn = moved.dtype.type(0), moved.dtype.type(0)
        mean[:], heavy[:] = 0, 0
        for j in range(count):
            stiff = strength[j] * known.scale[j] * known.scale[j]
            pull = strength[j] * known.scale[j] * error[j, i]
            whole += stiff
            drawn += pull
            own, share = moved[j, i], known.share[j]
            for k in range(dim):
                mean[k] += share * own[k]
                heavy[k] += stiff * own[k]
                gradient[k] += pull * own[k]
            for a in range(3, dim):
                if own[a] != 0:
                    factor, row = stiff * own[a], curvature[a]
                    for k in range(dim):
                        row[k] += factor * own[k]
        for k in range(dim):
            gradient[k] -= drawn * mean[k]
        for a in range(3, dim):
            first, second, row = mean[a], whole * mean[a] - heavy[a], curvature[a]
            for k in range(dim):
                row[k] += second * mean[k] - first * heavy[k]
