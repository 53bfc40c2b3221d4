"""Residuals of 3D joints and their derivatives as compiled loops, for plain tensors on the CPU.

Says the same as ``JointPosition`` in torch, which tests hold it equal to.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.energy.joint_position import SHORTEST, JointPosition

Floats = NDArray[np.floating[Any]]


class _Known(NamedTuple):
    """The arrays of a ``JointPosition`` of N frames."""

    direction: Floats  # (N, C, J, 3)
    bones: Floats  # (J, J)
    chain: Floats  # (J, J)
    share: Floats  # (J,)
    scale: Floats  # (J,)


def residual(energy: JointPosition, joints: Tensor) -> Tensor:
    """(*b, F, C * J, 3) of joints (*b, F, J, 3)."""
    known, (*lead, count, _) = _known(energy), joints.shape
    views = known.direction.shape[1]
    error = joints.new_empty(*lead, views * count, 3)
    _residual(known, _rows(joints, count, 3), error.numpy().reshape(-1, views, count, 3, 1))
    return error


def derivative(energy: JointPosition, joints: Tensor, jacobian: Tensor) -> Tensor:
    """(*b, F, C * J, 3, D) from that of the joints, (*b, F, J, 3, D)."""
    known, (*lead, count, _, dim) = _known(energy), jacobian.shape
    views = known.direction.shape[1]
    moved = joints.new_empty(*lead, views * count, 3, dim)
    _derivative(
        known,
        _rows(joints, count, 3),
        _rows(jacobian, count, 3, dim),
        moved.numpy().reshape(-1, views, count, 3, dim),
        SHORTEST,
    )
    return moved


def _known(energy: JointPosition) -> _Known:
    views, count = energy.direction.shape[-3:-1]
    constants = (energy.bones, energy.chain, energy.share, energy.scale)
    return _Known(_rows(energy.direction, views, count, 3), *(x.numpy() for x in constants))


def _rows(tensor: Tensor, *shape: int) -> Floats:
    """Contiguous, as another memory layout would compile the kernels once more."""
    return np.ascontiguousarray(tensor.detach().numpy()).reshape(-1, *shape)


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _bone(known: _Known, joints: Floats, bone: int) -> tuple[float, float, float, float]:
    """Vector of a bone and its length."""
    x, y, z = 0.0, 0.0, 0.0
    for j in range(len(joints)):
        share = known.bones[bone, j]
        if share != 0:
            x += share * joints[j, 0]
            y += share * joints[j, 1]
            z += share * joints[j, 2]
    return x, y, z, np.sqrt(x * x + y * y + z * z)


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _residual(known: _Known, joints: Floats, error: Floats) -> None:
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


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _derivative(
    known: _Known, joints: Floats, jacobian: Floats, moved: Floats, shortest: float
) -> None:
    """The same, (N, C, J, 3, D), of the derivative of joints (N, J, 3, D)."""
    longer = np.empty((jacobian.shape[1], jacobian.shape[3]), jacobian.dtype)
    for n in range(len(joints)):
        _lengthen(known, joints[n], jacobian[n], longer, shortest)
        for view in range(moved.shape[1]):
            for j in range(len(longer)):
                for i in range(3):
                    for k in range(longer.shape[1]):
                        moved[n, view, j, i, k] = jacobian[n, j, i, k]
            _subtract_predictions(known, known.direction[n, view], longer, moved[n, view])


@numba.njit(nogil=True, cache=True, fastmath={"contract"})  # type: ignore[untyped-decorator]
def _subtract_predictions(known: _Known, direction: Floats, length: Floats, moved: Floats) -> None:
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


@numba.njit(nogil=True, cache=True, fastmath={"contract"})  # type: ignore[untyped-decorator]
def _lengthen(
    known: _Known, joints: Floats, jacobian: Floats, longer: Floats, shortest: float
) -> None:
    """Derivative (J, D) of the lengths of bones; a bone of no length has none."""
    for bone in range(len(longer)):
        for k in range(longer.shape[1]):
            longer[bone, k] = 0
        x, y, z, length = _bone(known, joints, bone)
        for j in range(len(joints)):
            share = known.bones[bone, j] / max(length, shortest)
            if share != 0:
                for k in range(longer.shape[1]):
                    longer[bone, k] += share * (
                        x * jacobian[j, 0, k] + y * jacobian[j, 1, k] + z * jacobian[j, 2, k]
                    )
