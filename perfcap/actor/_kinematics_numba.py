"""Kinematics as compiled loops over poses, for plain tensors on the CPU.

Says the same as ``_kinematics_torch.py``, which tests hold it equal to, some 20 times faster at a
window's size, where torch spends its time between operations.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.kinematic_tree import KinematicTree, Pose
from perfcap.actor.motion import Motion
from perfcap.geometry._rotation_numba import rotvec_to_matrix

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]


class _Tree(NamedTuple):
    """The arrays of a ``KinematicTree``; bones have the lengths of each batch element."""

    axes: Floats  # (A, 3)
    slots: Indices  # (J, K)
    unrest: Floats  # (J, 3, 3)
    parents: Indices  # (J,)
    hinge_joint: Indices  # (A,)
    bone_start: Indices  # (J + L,)
    bone_group: Indices  # (J + L,)
    moves: Floats  # (L, A)
    bones: Floats  # (B, J + L, 3)


class _Poses(NamedTuple):
    """What the kernels write, for each of N poses; bones and axes are in the world."""

    rotation: Floats  # (N, J, 3, 3)
    points: Floats  # (N, J + L, 3)
    bones: Floats  # (N, J + L, 3)
    axes: Floats  # (N, A, 3)


def place(tree: KinematicTree, motion: Motion) -> Pose:
    """Posed joints and landmarks of a motion (*b, F)."""
    return _solve(tree, motion)[0]


def linearize(tree: KinematicTree, motion: Motion) -> tuple[Tensor, Tensor, Tensor | None]:
    """Landmarks and their derivatives; see ``Skeleton.linearize``."""
    pose, arrays, poses = _solve(tree, motion)
    lead, marks = motion.angles.shape[:-1], len(tree.moves)
    frame = motion.angles.new_empty(*lead, marks, 3, motion.frame_dim)
    _frame_jacobian(arrays, poses, frame.numpy().reshape(-1, marks, 3, motion.frame_dim))
    if motion.shape is None:
        return pose.landmarks, frame, None
    shared = motion.angles.new_zeros(*lead, marks, 3, motion.shared_dim)
    _shape_jacobian(arrays, poses, shared.numpy().reshape(-1, marks, 3, motion.shared_dim))
    return pose.landmarks, frame, shared


def _solve(tree: KinematicTree, motion: Motion) -> tuple[Pose, _Tree, _Poses]:
    """Poses as tensors, and the same memory as arrays."""
    lead = motion.angles.shape[:-1]
    points = tree.scaled_bones(motion.shape).expand(*motion.angles.shape[:-2], -1, -1)
    arrays = _Tree(
        *(getattr(tree, name).numpy() for name in _Tree._fields[:-1]),
        bones=points.numpy().reshape(-1, *points.shape[-2:]),
    )
    new = motion.angles.new_empty
    rotation, position = new(*lead, tree.joints, 3, 3), new(*lead, *tree.bone_vectors.shape)
    poses = _Poses(
        rotation.numpy().reshape(-1, tree.joints, 3, 3),
        position.numpy().reshape(-1, *tree.bone_vectors.shape),
        *(np.empty((lead.numel(), len(x), 3), arrays.axes.dtype) for x in (arrays.bones[0], arrays.axes)),
    )
    _place(arrays, *(_rows(x) for x in (motion.translation, motion.rotation, motion.angles)), poses)
    joints, landmarks = position.tensor_split((tree.joints,), -2)
    return Pose(rotation, joints, landmarks), arrays, poses


def _rows(tensor: Tensor) -> Floats:
    rows: Floats = tensor.detach().numpy().reshape(-1, tensor.shape[-1])
    return rows


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _place(
    tree: _Tree, translation: Floats, rotvec: Floats, angles: Floats, poses: _Poses
) -> None:
    """Rotations of joints, world axes of hinges, bones and points of N poses."""
    frames = len(angles) // len(tree.bones)
    for n in range(len(angles)):
        rotation = poses.rotation[n]
        for joint in range(len(tree.parents)):
            parent = tree.parents[joint]
            if parent < 0:
                rotvec_to_matrix(rotvec[n], rotation[joint])
            else:
                rotation[joint] = rotation[parent]
            for angle in tree.slots[joint]:
                if angle < len(tree.axes):
                    _turn(rotation[joint], tree.axes[angle], angles[n, angle], poses.axes[n, angle])
            _multiply(rotation[joint], tree.unrest[joint])
        _place_points(tree, n, tree.bones[n // frames], translation[n], poses)


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _place_points(
    tree: _Tree, n: int, vectors: Floats, translation: Floats, poses: _Poses
) -> None:
    """Bones in the world and the joints and landmarks they lead to; the root's bone is zero."""
    points, bones = poses.points[n], poses.bones[n]
    for end in range(len(points)):
        start = tree.bone_start[end]
        for i in range(3):
            bone = 0 * vectors[end, i]
            for k in range(3):
                bone += poses.rotation[n, start, i, k] * vectors[end, k]
            bones[end, i] = bone
            points[end, i] = bone + (points[start, i] if end > 0 else translation[i])


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _turn(matrix: Floats, axis: Floats, angle: float, world_axis: Floats) -> None:
    """``matrix @ R(axis, angle)`` in place, by Rodrigues' formula on rows; and ``matrix @ axis``."""
    sine, cosine = math.sin(angle), math.cos(angle)
    a, b, c = axis
    for i in range(3):
        x, y, z = matrix[i]
        along = x * a + y * b + z * c
        world_axis[i] = along
        keep = (1 - cosine) * along
        matrix[i, 0] = cosine * x + sine * (y * c - z * b) + keep * a
        matrix[i, 1] = cosine * y + sine * (z * a - x * c) + keep * b
        matrix[i, 2] = cosine * z + sine * (x * b - y * a) + keep * c


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _multiply(matrix: Floats, right: Floats) -> None:
    """``matrix @ right`` in place, (3, 3)."""
    for i in range(3):
        x, y, z = matrix[i]
        for k in range(3):
            matrix[i, k] = x * right[0, k] + y * right[1, k] + z * right[2, k]


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _frame_jacobian(tree: _Tree, poses: _Poses, jacobian: Floats) -> None:
    """Derivative (N, L, 3, 6 + A) in translation, rotation and angles: axis x (point - joint)."""
    joints = len(tree.parents)
    for n in range(len(jacobian)):
        points, axes = poses.points[n], poses.axes[n]
        for mark in range(len(tree.moves)):
            rows = jacobian[n, mark]
            rows[:] = 0
            x, y, z = points[joints + mark] - points[0]
            rows[0, 0] = rows[1, 1] = rows[2, 2] = 1
            rows[0, 4], rows[0, 5], rows[1, 5] = z, -y, x
            rows[1, 3], rows[2, 3], rows[2, 4] = -z, y, -x
            for angle in range(len(axes)):
                if tree.moves[mark, angle] != 0:
                    x, y, z = points[joints + mark] - points[tree.hinge_joint[angle]]
                    a, b, c = axes[angle]
                    rows[0, 6 + angle] = b * z - c * y
                    rows[1, 6 + angle] = c * x - a * z
                    rows[2, 6 + angle] = a * y - b * x


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _shape_jacobian(tree: _Tree, poses: _Poses, jacobian: Floats) -> None:
    """Derivative (N, L, 3, S) in the log bone lengths, added: bones on the way, by group."""
    joints = len(tree.parents)
    for n in range(len(jacobian)):
        for mark in range(len(tree.moves)):
            bone = joints + mark
            while bone > 0:
                jacobian[n, mark, :, tree.bone_group[bone]] += poses.bones[n, bone]
                bone = tree.bone_start[bone]
