"""BVH: a skeleton in motion as its files describe it, read from text as untrusted data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import Template
from perfcap.errors import InputError

# --- A skeleton in motion as BVH files describe it ------------------------------------------------
#
# A joint frame has the world's axes in the rest pose. Joints may move against their parent: their
# position replaces the rest offset.

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BvhMotion:
    """A skeleton and its motion.

    Attributes:
        names: joint names, (J,).
        parents: parent of each joint, -1 for the one root, parents first, (J,).
        offsets: rest position of each joint in its parent, world axes, (J, 3) m.
        rotations: joint-to-parent rotations, (F, J, 3, 3).
        positions: joint origins in the parent's frame, the root's in the world, (F, J, 3) m.
        frame_time: seconds between frames.
        ends: tip of each leaf in its joint's frame, NaN for the others, (J, 3) m; None to
            prolong each leaf by a quarter of its own offset.
    """

    names: tuple[str, ...]
    parents: Integers
    offsets: Floats
    rotations: Floats
    positions: Floats
    frame_time: float
    ends: Floats | None = None

    def __post_init__(self) -> None:
        joints, frames = len(self.names), len(self.rotations)
        parents = np.asarray(self.parents)
        expected = {"offsets": (joints, 3), "positions": (frames, joints, 3)}
        for name, shape in (expected | {"rotations": (frames, joints, 3, 3)}).items():
            array = getattr(self, name)
            if array.shape != shape or not np.isfinite(array).all():
                raise InputError(f"{name} has shape {array.shape}; expected finite {shape}")
        if parents.shape != (joints,) or not joints or not frames:
            raise InputError(f"{joints} joints with parents {parents.shape} and {frames} frames")
        if parents[0] != -1 or np.any(parents[1:] < 0) or np.any(parents >= np.arange(joints)):
            raise InputError("parents has no single root first; BVH holds one tree, parents first")
        if not (np.isfinite(self.frame_time) and self.frame_time > 0):
            raise InputError(f"frame_time is {self.frame_time}; expected seconds above zero")


def bvh_motion(template: Template, bone_transforms: Floats, fps: float) -> BvhMotion:
    """Motion of an actor's own skeleton.

    BVH holds one tree: roots after the first hang on the first one, against which they may move.

    Args:
        template: the rig; its bones become the joints.
        bone_transforms: rigid rest-to-posed transforms in the world, (F, B, 4, 4) m.
        fps: frames per second.
    """
    parents = np.where(template.bone_parents < 0, 0, template.bone_parents)
    parents[0] = -1
    rest = template.bone_rest[:, :3, 3]
    above = np.maximum(parents, 0)
    turned = bone_transforms[..., :3, :3]
    posed = (turned @ rest[:, :, None])[..., 0] + bone_transforms[..., :3, 3]
    to_parent = np.where((parents < 0)[:, None, None], np.eye(3), turned[:, above].mT)
    origin = np.where((parents < 0)[:, None], 0.0, posed[:, above])
    return BvhMotion(
        names=template.bone_names,
        parents=parents,
        offsets=rest - np.where((parents < 0)[:, None], 0.0, rest[above]),
        rotations=to_parent @ turned,
        positions=(to_parent @ (posed - origin)[..., None])[..., 0],
        frame_time=1 / fps,
    )


def joint_positions(motion: BvhMotion) -> Floats:
    """World positions of the joints, (F, J, 3) m."""
    rotations, places = motion.rotations.copy(), motion.positions.copy()
    for joint, parent in enumerate(motion.parents.tolist()):
        if parent >= 0:
            above = rotations[:, parent]
            places[:, joint] = places[:, parent] + (above @ places[:, joint, :, None])[..., 0]
            rotations[:, joint] = above @ rotations[:, joint]
    return places


# --- Read skeletal motion from BVH text, as untrusted data ----------------------------------------

_FRAME_TIMES = 1e-5, 100.0  # s
_MAX_BYTES, _MAX_JOINTS, _MAX_NUMBERS = 1 << 28, 1024, 1 << 26
_AXES = "XYZ"


@dataclass
class _Joint:
    """A joint while its block is being read."""

    name: str
    parent: int
    offset: list[float]
    channels: list[str]
    end: list[float] | None = None


def require_length(metres_per_unit: float) -> None:
    """Refuse a unit of length that is none.

    Raises:
        InputError: it is zero, negative or no number.
    """
    if not 0 < metres_per_unit < np.inf:
        raise InputError(f"metres_per_unit is {metres_per_unit}; expected metres, such as 0.01")


def load_bvh(path: str | Path, metres_per_unit: float = 0.01) -> BvhMotion:
    """Read a BVH file with one root.

    Args:
        path: the file.
        metres_per_unit: the file's length unit, which BVH does not state.

    Raises:
        InputError: missing, malformed, truncated or oversized file, or a unit that is none.
    """
    require_length(metres_per_unit)
    path = Path(path)
    text = _read(path)
    head, separator, tail = text.partition("MOTION")
    if not separator or not head.lstrip().startswith("HIERARCHY"):
        raise InputError(f"{path}: not a BVH file (no HIERARCHY and MOTION)")
    joints = _parse_hierarchy(path, head.split()[1:])
    table, frame_time = _parse_motion(path, tail, sum(len(j.channels) for j in joints))
    rotations = np.tile(np.eye(3), (len(table), len(joints), 1, 1))
    positions = np.tile([joint.offset for joint in joints], (len(table), 1, 1))
    column = 0
    for number, joint in enumerate(joints):
        for channel in joint.channels:
            axis, kind = _AXES.index(channel[0]), channel[1:]
            if kind == "position":
                positions[:, number, axis] = table[:, column]
            else:
                turn = _axis_rotation(axis, np.radians(table[:, column]))
                rotations[:, number] = rotations[:, number] @ turn
            column += 1
    ends = np.array([joint.end or [np.nan] * 3 for joint in joints])
    return BvhMotion(
        names=tuple(joint.name for joint in joints),
        parents=np.array([joint.parent for joint in joints]),
        offsets=np.array([joint.offset for joint in joints]) * metres_per_unit,
        rotations=rotations,
        positions=positions * metres_per_unit,
        frame_time=frame_time,
        ends=ends * metres_per_unit,
    )


def _read(path: Path) -> str:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path}: larger than {_MAX_BYTES} bytes; cut the clip")
        return path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def _parse_hierarchy(path: Path, words: list[str]) -> list[_Joint]:
    joints: list[_Joint] = []
    open_blocks: list[int] = []  # joint of each open brace; -1 - joint for its end site
    stream = iter(words)
    try:
        for word in stream:
            if word in ("ROOT", "JOINT"):
                parent = open_blocks[-1] if word == "JOINT" else -1
                name = next(stream)
                joints.append(_Joint(name, parent, [0.0] * 3, []))
                _expect(next(stream), "{")
                open_blocks.append(len(joints) - 1)
            elif word == "End":
                _expect(next(stream), "Site")
                _expect(next(stream), "{")
                open_blocks.append(-1 - open_blocks[-1])
            elif word == "OFFSET":
                _set_offset(joints, open_blocks[-1], [_finite(next(stream)) for _ in range(3)])
            elif word == "CHANNELS":
                count = int(next(stream))
                joints[open_blocks[-1]].channels = [_channel(next(stream)) for _ in range(count)]
            else:
                _expect(word, "}")
                open_blocks.pop()
            if len(joints) > _MAX_JOINTS:
                raise InputError(f"{path}: more than {_MAX_JOINTS} joints")
    except (StopIteration, ValueError, IndexError) as error:
        hint = "; expected numbers with points, not commas" if "," in str(error) else ""
        raise InputError(
            f"{path}: malformed BVH hierarchy near joint {len(joints)}{hint}"
        ) from error
    if open_blocks or not joints or sum(joint.parent < 0 for joint in joints) != 1:
        raise InputError(f"{path}: BVH hierarchy with unclosed braces or not exactly one root")
    return joints


def _expect(found: str, expected: str) -> None:
    if found != expected:
        raise ValueError(found)


def _finite(word: str) -> float:
    value = float(word)
    if not np.isfinite(value):
        raise ValueError(word)
    return value


def _set_offset(joints: list[_Joint], block: int, offset: list[float]) -> None:
    if block >= 0:
        joints[block].offset = offset
    else:
        joints[-1 - block].end = offset


def _channel(word: str) -> str:
    if word[:1] not in tuple(_AXES) or word[1:] not in ("position", "rotation"):
        raise ValueError(word)
    return word


def _parse_motion(path: Path, text: str, columns: int) -> tuple[Floats, float]:
    """Channel values (F, columns) and the frame time in seconds."""
    words = text.split(maxsplit=5)
    try:
        if words[0] != "Frames:" or words[2:4] != ["Frame", "Time:"]:
            raise ValueError(words[:4])
        frames, frame_time = int(words[1]), _finite(words[4])
        if not 0 < frames * columns <= _MAX_NUMBERS:
            raise ValueError(frames)
        numbers = np.array(words[5].split(), dtype=np.float64)
        if not np.isfinite(numbers).all():
            raise ValueError("NaN or infinity")
        numbers = numbers.reshape(frames, columns)
    except (ValueError, IndexError) as error:
        raise InputError(
            f"{path}: malformed BVH motion; expected frames of {columns} numbers as declared"
        ) from error
    if not _FRAME_TIMES[0] <= frame_time <= _FRAME_TIMES[1]:
        raise InputError(
            f"{path}: Frame Time is {frame_time:g}; expected the seconds that a frame takes, such "
            "as 0.0333"
        )
    return numbers, frame_time


def _axis_rotation(axis: int, angle: Floats) -> Floats:
    """Rotations about a coordinate axis, (F, 3, 3)."""
    following, last = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.tile(np.eye(3), (len(angle), 1, 1))
    matrix[:, following, following] = matrix[:, last, last] = np.cos(angle)
    matrix[:, last, following] = np.sin(angle)
    matrix[:, following, last] = -np.sin(angle)
    return matrix
