"""Kinematics as compiled loops over poses, for plain tensors on the CPU.

Says the same as ``_kinematics_torch.py``, which tests hold it equal to, some 20 times faster at a
window's size, where torch spends its time between operations.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.kinematic_tree import KinematicTree, Pose
from perfcap.actor.motion import BONES, Motion
from perfcap.geometry._rotation_numba import rotvec_to_matrix
from perfcap.kernels import inner, kernel

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]
_Row = tuple[float, float, float]


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
    order: Indices  # (J + L,)
    bones: Floats  # (B, J + L, 3)


class _Clavicles(NamedTuple):
    """The arrays of ``ClavicleTurns``, and how far the K clavicles turn in each of N poses."""

    joint: Indices  # (K,)
    carried: Indices  # (K,)
    lifts: Indices  # (K, 2)
    axes: Floats  # (K, 3)
    turns: Floats  # (N, K)
    slopes: Floats  # (N, K, 2)


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
    rows = frame.numpy().reshape(-1, marks, 3, motion.frame_dim)
    _frame_jacobian(arrays, poses, rows)
    if tree.clavicles.count:
        _add_drifts(arrays, _clavicles(tree, motion), poses, rows)
    if BONES not in motion.shared:
        return pose.landmarks, frame, None
    groups = len(tree.group_names)
    shared = motion.angles.new_empty(*lead, marks, 3, groups)
    _shape_jacobian(arrays, poses, shared.numpy().reshape(-1, marks, 3, groups))
    return pose.landmarks, frame, shared


def _solve(tree: KinematicTree, motion: Motion) -> tuple[Pose, _Tree, _Poses]:
    """Poses as tensors, and the same memory as arrays."""
    lead = motion.angles.shape[:-1]
    vectors = tree.scaled_bones(motion.shared.get(BONES))
    if BONES in motion.shared:
        vectors = vectors.expand(*lead[:-1], *vectors.shape[-2:])
    constants = {name: getattr(tree, name).numpy() for name in _Tree._fields[:-1]}
    arrays = _Tree(**constants, bones=_rows(vectors, *vectors.shape[-2:]))
    new = motion.angles.new_empty
    rotation, position = new(*lead, tree.joints, 3, 3), new(*lead, *tree.bone_vectors.shape)
    poses = _Poses(
        rotation.numpy().reshape(-1, tree.joints, 3, 3),
        position.numpy().reshape(-1, *tree.bone_vectors.shape),
        *(
            np.empty((lead.numel(), len(x), 3), arrays.axes.dtype)
            for x in (arrays.bones[0], arrays.axes)
        ),
    )
    unknowns = (motion.translation, motion.rotation, motion.angles)
    _place(arrays, _clavicles(tree, motion), *(_rows(x, x.shape[-1]) for x in unknowns), poses)
    joints, landmarks = position.tensor_split((tree.joints,), -2)
    return Pose(rotation, joints, landmarks), arrays, poses


def _clavicles(tree: KinematicTree, motion: Motion) -> _Clavicles:
    every, count = tree.clavicles, tree.clavicles.count
    if not count:  # nothing to compute: most rigs have none
        kind, none = motion.angles.numpy().dtype, np.empty(0, np.int64)
        vectors: Floats = np.empty((0, 3), kind)
        slopes: Floats = np.empty((0, 0, 2), kind)
        return _Clavicles(none, none, none.reshape(0, 2), vectors, vectors.reshape(0, 0), slopes)
    return _Clavicles(
        **{name: getattr(every, name).numpy() for name in _Clavicles._fields[:-2]},
        turns=_rows(every(motion.angles), count),
        slopes=_rows(every.slopes(motion.angles), count, 2),
    )


def _rows(tensor: Tensor, *shape: int) -> Floats:
    """Contiguous, as another memory layout would compile the kernels once more."""
    return np.ascontiguousarray(tensor.detach().numpy()).reshape(-1, *shape)


@kernel()
def _place(
    tree: _Tree,
    clavicles: _Clavicles,
    translation: Floats,
    rotvec: Floats,
    angles: Floats,
    poses: _Poses,
) -> None:
    """Rotations of joints, world axes of hinges, bones and points of N poses."""
    frames = len(angles) // max(1, len(tree.bones))
    sine, cosine = np.sin(angles), np.cos(angles)
    for n in range(len(angles)):
        rotvec_to_matrix(rotvec, n, poses.rotation[n, 0])
        for joint in range(len(tree.parents)):
            _turn_joint(tree, joint, n, sine, cosine, poses)
        _turn_clavicles(tree, clavicles, n, poses)
        _place_points(tree, n, tree.bones[n // frames], translation, poses)


@inner()
def _turn_joint(
    tree: _Tree, joint: int, n: int, sine: Floats, cosine: Floats, poses: _Poses
) -> None:
    """Rotation of a joint, given its parent's, and the world axes of its hinges.

    Rows of a product depend on the same row of its first factor only: three rows pass through the
    hinges side by side without touching memory.
    """
    parent = max(tree.parents[joint], 0)  # the root finds the root rotation in its own place
    top, middle, bottom = (
        _row(poses.rotation, n, parent, 0),
        _row(poses.rotation, n, parent, 1),
        _row(poses.rotation, n, parent, 2),
    )
    for slot in range(tree.slots.shape[1]):
        angle = tree.slots[joint, slot]
        if angle < len(tree.axes):
            axis = tree.axes[angle, 0], tree.axes[angle, 1], tree.axes[angle, 2]
            s, c = sine[n, angle], cosine[n, angle]
            top, poses.axes[n, angle, 0] = _turn(top, axis, s, c)
            middle, poses.axes[n, angle, 1] = _turn(middle, axis, s, c)
            bottom, poses.axes[n, angle, 2] = _turn(bottom, axis, s, c)
    for k in range(3):
        column = tree.unrest[joint, 0, k], tree.unrest[joint, 1, k], tree.unrest[joint, 2, k]
        poses.rotation[n, joint, 0, k] = _dot(top, column)
        poses.rotation[n, joint, 1, k] = _dot(middle, column)
        poses.rotation[n, joint, 2, k] = _dot(bottom, column)


@inner()
def _turn_clavicles(tree: _Tree, clavicles: _Clavicles, n: int, poses: _Poses) -> None:
    """Rotations of clavicles, given their parents'; no joint inherits them."""
    for k in range(len(clavicles.joint)):
        joint, angle = clavicles.joint[k], clavicles.turns[n, k]
        axis = clavicles.axes[k, 0], clavicles.axes[k, 1], clavicles.axes[k, 2]
        for i in range(3):
            row = _row(poses.rotation, n, tree.parents[joint], i)
            turned, _ = _turn(row, axis, np.sin(angle), np.cos(angle))
            for j in range(3):
                poses.rotation[n, joint, i, j] = turned[j]


@inner()
def _row(matrices: Floats, n: int, joint: int, i: int) -> _Row:
    return matrices[n, joint, i, 0], matrices[n, joint, i, 1], matrices[n, joint, i, 2]


@inner()
def _dot(a: _Row, b: _Row) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner()
def _turn(row: _Row, axis: _Row, sine: float, cosine: float) -> tuple[_Row, float]:
    """``row @ R(axis, angle)`` by Rodrigues' formula, and ``row . axis``."""
    (x, y, z), (a, b, c) = row, axis
    along = _dot(row, axis)
    keep = (1 - cosine) * along
    turned = (
        cosine * x + sine * (y * c - z * b) + keep * a,
        cosine * y + sine * (z * a - x * c) + keep * b,
        cosine * z + sine * (x * b - y * a) + keep * c,
    )
    return turned, along


@inner()
def _place_points(tree: _Tree, n: int, vectors: Floats, translation: Floats, poses: _Poses) -> None:
    """Bones in the world and the joints and landmarks they lead to; the root's bone is zero."""
    for end in tree.order:
        start = tree.bone_start[end]
        vector = vectors[end, 0], vectors[end, 1], vectors[end, 2]
        for i in range(3):
            bone = _dot(_row(poses.rotation, n, start, i), vector)
            origin = poses.points[n, start, i] if end > 0 else translation[n, i]
            poses.bones[n, end, i] = bone
            poses.points[n, end, i] = bone + origin


@kernel()
def _frame_jacobian(tree: _Tree, poses: _Poses, jacobian: Floats) -> None:
    """Derivative (N, L, 3, 6 + A) in translation, rotation and angles: axis x (point - joint)."""
    joints = len(tree.parents)
    jacobian[:] = 0
    for n in range(len(jacobian)):
        points, axes = poses.points[n], poses.axes[n]
        for mark in range(len(tree.moves)):
            rows, here = jacobian[n, mark], points[joints + mark]
            for i in range(3):
                rows[i, i] = 1
                j, k = (i + 1) % 3, (i + 2) % 3
                rows[i, 3 + j] = here[k] - points[0, k]
                rows[i, 3 + k] = points[0, j] - here[j]
            for angle in range(len(axes)):
                if tree.moves[mark, angle] != 0:
                    centre = points[tree.hinge_joint[angle]]
                    x, y, z = here[0] - centre[0], here[1] - centre[1], here[2] - centre[2]
                    a, b, c = axes[angle, 0], axes[angle, 1], axes[angle, 2]
                    rows[0, 6 + angle] = b * z - c * y
                    rows[1, 6 + angle] = c * x - a * z
                    rows[2, 6 + angle] = a * y - b * x


@kernel()
def _add_drifts(tree: _Tree, clavicles: _Clavicles, poses: _Poses, jacobian: Floats) -> None:
    """Add how angles shift landmarks through clavicles: slope * (axis x clavicle)."""
    for n in range(len(jacobian)):
        for k in range(len(clavicles.joint)):
            start, end = clavicles.joint[k], clavicles.carried[k]
            axis, arm = np.zeros(3), poses.points[n, end] - poses.points[n, start]
            for i in range(3):
                axis[i] = _dot(
                    _row(poses.rotation, n, start, i),
                    (clavicles.axes[k, 0], clavicles.axes[k, 1], clavicles.axes[k, 2]),
                )
            for i in range(3):
                j, m = (i + 1) % 3, (i + 2) % 3
                velocity = axis[j] * arm[m] - axis[m] * arm[j]
                for lift in range(2):
                    angle, slope = clavicles.lifts[k, lift], clavicles.slopes[n, k, lift]
                    for mark in range(len(tree.moves)):
                        if tree.moves[mark, angle] != 0:
                            jacobian[n, mark, i, 6 + angle] += slope * velocity


@kernel()
def _shape_jacobian(tree: _Tree, poses: _Poses, jacobian: Floats) -> None:
    """Derivative (N, L, 3, S) in the log bone lengths: the bones on the way, by group."""
    jacobian[:] = 0
    for n in range(len(jacobian)):
        for mark in range(len(tree.moves)):
            bone = len(tree.parents) + mark
            while bone > 0:
                for i in range(3):
                    jacobian[n, mark, i, tree.bone_group[bone]] += poses.bones[n, bone, i]
                bone = tree.bone_start[bone]
