"""Write skeletal motion as BVH text: y up, one length unit, Euler angles in degrees."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.bvh_read import BvhMotion, Floats, Integers, require_length
from perfcap.io.written_checks import require_metric, warn_of_places, warn_of_rate

_AXES = "XYZ"
_ORDERS = ("ZXY", "ZYX", "XYZ", "XZY", "YXZ", "YZX")
_STILL = 1e-6  # metres: joints that move less against their parent get no position channels
_RIGID = 1e-3  # of the product of a rotation and its transpose
_GIMBAL = 1e-6  # cosine of the middle angle below which only one other angle is defined


def euler_angles(rotations: Floats, order: str = "ZXY") -> Floats:
    """Continuous intrinsic Euler angles: ``R = R_order[0] R_order[1] R_order[2]``.

    Each rotation has two sets of angles, each up to full turns. The first frame takes the set
    with the middle angle within a quarter turn, every later one the set nearest to the frame
    before it. At gimbal lock the last angle keeps its value.

    Args:
        rotations: (F, ..., 3, 3).
        order: three different axes, such as ``ZXY``.

    Returns:
        Angles in the order of the axes, (F, ..., 3) rad.
    """
    i, j, k = (_AXES.index(axis) for axis in order)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    angles = np.empty(rotations.shape[:-1])
    previous = np.zeros(rotations.shape[1:-1])
    for frame, matrix in enumerate(rotations):
        cosine = np.hypot(matrix[..., i, i], matrix[..., i, j])
        middle = np.arctan2(sign * matrix[..., i, k], cosine)
        last = np.arctan2(-sign * matrix[..., i, j], matrix[..., i, i])
        last = np.where(cosine < _GIMBAL, previous[..., 2], last)
        # Undo the last rotation; the first one is then well defined, also at gimbal lock.
        side = (
            np.cos(last)[..., None] * matrix[..., j]
            + sign * np.sin(last)[..., None] * (matrix[..., i])
        )
        first = np.arctan2(sign * side[..., k], side[..., j])
        one = np.stack([first, middle, last], axis=-1)
        two = np.stack([first + np.pi, np.pi - middle, last + np.pi], axis=-1)
        previous = one if frame == 0 else _nearest(one, two, previous)
        angles[frame] = previous
    return angles


def _calmest_orders(rotations: Floats) -> tuple[str, ...]:
    """For each joint the order of axes whose angles move the least between frames.

    Angles of any order race where its middle axis nears a quarter turn; for the joints of a person
    another order is then far from there.

    Args:
        rotations: joint-to-parent rotations, (F, J, 3, 3).
    """
    steps = [
        np.abs(np.diff(euler_angles(rotations, order), axis=0)).max(axis=(0, 2), initial=0.0)
        for order in _ORDERS
    ]
    # a hundredth of a degree is no reason to leave the usual order, the first one
    return tuple(_ORDERS[best] for best in np.round(steps, 4).argmin(0))


def _nearest(one: Floats, two: Floats, previous: Floats) -> Floats:
    """Of two sets of angles, moved by full turns, the one closer to the previous set."""
    turn = 2 * np.pi
    one = one - turn * np.round((one - previous) / turn)
    two = two - turn * np.round((two - previous) / turn)
    apart = [np.abs(angles - previous).sum(-1, keepdims=True) for angles in (one, two)]
    nearest: Floats = np.where(apart[0] <= apart[1], one, two)
    return nearest


def save_bvh(
    path: str | Path,
    motion: BvhMotion,
    metres_per_unit: float = 0.01,
    order: str | Sequence[str] = "auto",
    *,
    examined: bool = False,
) -> None:
    """Write a motion; the file appears complete or not at all.

    BVH has no units: tell readers what ``metres_per_unit`` was (0.01 writes centimetres).

    Args:
        path: where to write.
        motion: what to write.
        metres_per_unit: the unit of the file.
        order: of the axes that joints turn about, for all of them or for each, (J,); ``auto`` takes
            for each the one whose angles move the least between frames.
        examined: whether the caller has looked at places and times; else odd ones are warned of.

    Raises:
        InputError: an order, a unit or rotations that are none, or offsets in another unit.
    """
    require_length(metres_per_unit)
    turns = motion.rotations
    off = np.abs(turns @ turns.swapaxes(-1, -2) - np.eye(3)).max(initial=0.0)
    if off > _RIGID or np.linalg.det(turns).min(initial=1.0) < 0:
        raise InputError(
            f"{path}: rotations are off by up to {off:.2g}, or mirror images; expected matrices of "
            "rotations, without a scale"
        )
    require_metric(motion.offsets)
    if not examined:
        warn_of_rate(1 / motion.frame_time, level=2)
        warn_of_places(motion.offsets, motion.positions, motion.frame_time, level=2)
    auto = order == "auto"
    orders = _calmest_orders(motion.rotations) if auto else _checked(order, len(motion.names))
    scale = 1 / metres_per_unit
    moves = np.abs(motion.positions - motion.offsets).max(axis=(0, 2)) > _STILL
    moves[0] = True
    angles = np.empty(motion.rotations.shape[:-1])
    for one in dict.fromkeys(orders):
        alike = np.array([order == one for order in orders])
        angles[:, alike] = np.degrees(euler_angles(motion.rotations[:, alike], one))
    columns = []
    for joint in _depth_first(motion.parents):
        if moves[joint]:
            columns.append(motion.positions[:, joint] * scale)
        columns.append(angles[:, joint])
    table = np.concatenate(columns, axis=1)
    lines = ["HIERARCHY", *_hierarchy(motion, moves, orders, scale), "MOTION"]
    lines += [f"Frames: {len(table)}", f"Frame Time: {motion.frame_time:.9f}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in table]
    with writing(Path(path)) as file:
        file.write(("\n".join(lines) + "\n").encode())


def _depth_first(parents: Integers) -> list[int]:
    """The order in which a BVH hierarchy names the joints."""
    order, pending = [], [0]
    while pending:
        order.append(pending.pop())
        pending += np.flatnonzero(parents == order[-1])[::-1].tolist()
    return order


def _checked(order: str | Sequence[str], joints: int) -> tuple[str, ...]:
    orders = (order,) * joints if isinstance(order, str) else tuple(order)
    for one in orders:
        if one not in _ORDERS:
            raise InputError(f"order is {one!r}; expected X, Y and Z in some order, such as ZXY")
    if len(orders) != joints:
        raise InputError(f"order has {len(orders)} orders of axes; expected one or {joints}")
    return orders


def _hierarchy(
    motion: BvhMotion, moves: NDArray[np.bool_], orders: Sequence[str], scale: float
) -> list[str]:
    lines: list[str] = []
    depths: list[int] = []
    depth = np.zeros(len(motion.names), dtype=np.int64)
    for joint in _depth_first(motion.parents):
        parent = int(motion.parents[joint])
        depth[joint] = 0 if parent < 0 else depth[parent] + 1
        while len(depths) > depth[joint]:
            lines.append("\t" * depths.pop() + "}")
        tab = "\t" * depth[joint]
        channels = ["Xposition", "Yposition", "Zposition"] if moves[joint] else []
        channels += [f"{axis}rotation" for axis in orders[joint]]
        offset = motion.offsets[joint] * scale * (parent >= 0)
        lines += [
            f"{tab}{'ROOT' if parent < 0 else 'JOINT'} {'_'.join(motion.names[joint].split())}",
            tab + "{",
            f"{tab}\tOFFSET {_triple(offset)}",
            f"{tab}\tCHANNELS {len(channels)} {' '.join(channels)}",
        ]
        depths.append(int(depth[joint]))
        if not np.any(motion.parents == joint):
            lines += [f"{tab}\tEnd Site", tab + "\t{"]
            lines += [f"{tab}\t\tOFFSET {_triple(_tip(motion, joint) * scale)}", tab + "\t}"]
    return lines + ["\t" * level + "}" for level in depths[::-1]]


def _tip(motion: BvhMotion, joint: int) -> Floats:
    tip = 0.25 * motion.offsets[joint] if motion.ends is None else motion.ends[joint]
    # Readers drop bones without length, so a tip is never on its joint.
    usable = np.isfinite(tip).all() and np.linalg.norm(tip) > 1e-4
    return tip if usable else np.array([0.0, 0.01, 0.0])


def _triple(values: Floats) -> str:
    return " ".join(f"{value:.6f}" for value in values)
