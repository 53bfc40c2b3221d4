"""A skeleton in motion: of a finished capture, of a BVH file, or of an animated character."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_correction import SHORTEST, TALLEST
from perfcap.errors import InputError
from perfcap.io.actor_import import ActorMapping, ImportedActor, require_sound, rig_character
from perfcap.io.bvh_read import BvhMotion, joint_positions, load_bvh
from perfcap.io.bvh_rig import stick_figure, with_feet
from perfcap.io.bvh_standing import part_of, standing_pose, world_turns
from perfcap.io.distrust import distrust, kept
from perfcap.io.doctor.finding import Severity, ranges
from perfcap.io.files import named_path
from perfcap.io.gltf_clip import sample_clip
from perfcap.io.gltf_document import open_document, require_readable_kind
from perfcap.io.gltf_read import Character, read_character
from perfcap.io.gltf_scene import read_tree, rigid
from perfcap.io.result import read_result

Floats = NDArray[np.float64]

_BVH, _GLTF = ".bvh", (".glb", ".gltf", ".vrm")
_STATURE = 1.7  # m, of a figure in units that nobody knows
_FULL_TURN = 2 * np.pi  # of degrees: what radians that are taken for degrees come to at most
_NO_TURN = 1e-6  # degrees
_FEW = 10  # frames
_FIRST = slice(0, None)


@dataclass(frozen=True, eq=False)
class MovingRig:
    """The sixteen joints of a person in motion, and the skeleton that they are joints of.

    Attributes:
        actor: at rest: metres, y up, facing +z.
        rotation: rest-to-posed rotations of the joints in the world, (F, 16, 3, 3).
        position: of the joints in the world, (F, 16, 3) m.
        rate: frames a second.
        frames: numbers of the frames in the file, (F,).
        level: whether y is up in the world; a capture's is that of its calibration.
        world_to_floor: takes the world to one with the floor at y = 0, (4, 4); None if not known.
        notes: what a user should know.
        about: what reports of what is made of it pass on, as of frames not to be trusted.
    """

    actor: Actor
    rotation: Floats
    position: Floats
    rate: float
    frames: NDArray[np.int64]
    level: bool = True
    world_to_floor: Floats | None = None
    notes: tuple[str, ...] = ()
    about: Mapping[str, Any] = field(default_factory=dict)


def read_moving_rig(
    path: str | Path, frames: slice = _FIRST, mapping: ActorMapping | None = None
) -> MovingRig:
    """Read the folder of a capture, a ``.bvh``, or a ``.glb``, ``.gltf`` or ``.vrm`` that moves.

    Args:
        path: of it.
        frames: the part to take; frames of a capture are counted as in its video.
        mapping: bones of joints, and the unit, where the file does not tell.

    Raises:
        InputError: it cannot be read, does not move, or its joints cannot be found.
    """
    path = named_path(path, "path", _expected())
    mapping = mapping or ActorMapping()
    if path.is_dir():
        return _of_result(path, frames, mapping)
    if path.suffix.lower() == _BVH:
        return _of_bvh(path, frames, mapping)
    if path.suffix.lower() in _GLTF:
        return _of_character(path, frames, mapping)
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; expected {_expected()}")
    require_readable_kind(path)
    raise InputError(f"{path}: is of no kind that moves; expected {_expected()}")


def _expected() -> str:
    return f"the folder of a capture, a {_BVH}, or a {', '.join(_GLTF)} with an animation"


def _of_result(folder: Path, frames: slice, mapping: ActorMapping) -> MovingRig:
    result = read_result(folder)
    numbers = result.frame_numbers
    stop = int(numbers[-1]) + 1 if frames.stop is None else frames.stop
    chosen = np.flatnonzero((numbers >= frames.start) & (numbers < stop))
    _require_some(folder, len(chosen), f"{numbers[0]} to {numbers[-1]}")
    if mapping.metres_per_unit is not None:
        raise InputError(
            f"{folder}: is a capture, which is in metres, but the mapping of the source has "
            "metres_per_unit, which is the unit of a BVH file or a character; leave it out"
        )
    imported = rig_character(Character(result.template, (), ()), mapping)
    _require_bones(folder, imported, mapping)
    bones = _bones(imported)
    moved = result.bone_transforms[chosen][:, bones]
    rest = result.template.bone_rest[bones, :3, 3]
    position = (moved[..., :3, :3] @ rest[..., None])[..., 0] + moved[..., :3, 3]
    return replace(
        _corrected(imported, moved[..., :3, :3], position, result.rate, numbers[chosen]),
        level=result.level,
        world_to_floor=_floor(result.report),
        notes=(
            *_cut_short(folder, frames, int(numbers[-1]) + 1),
            *distrust(result.report, numbers[chosen]),
        ),
        about=kept(result.report),
    )


def _floor(report: Mapping[str, Any]) -> Floats | None:
    floor = report.get("floor")
    matrix = floor.get("world_to_floor") if isinstance(floor, dict) else None
    try:
        found = np.array(matrix, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    if found.shape != (4, 4) or not np.isfinite(found).all():
        return None
    turn = found[:3, :3]
    return found if np.abs(turn @ turn.T - np.eye(3)).max() < 1e-3 else None


def _of_bvh(path: Path, frames: slice, mapping: ActorMapping) -> MovingRig:
    whole = load_bvh(path, 1.0)
    numbers = np.arange(len(whole.rotations))[frames]
    _require_some(path, len(numbers), f"0 to {len(whole.rotations) - 1}")
    told = (*_cut_short(path, frames, len(whole.rotations)), *_odd_turns(path, whole, numbers))
    motion = part_of(whole, numbers)
    turns, places = world_turns(motion), joint_positions(motion)
    rest = np.zeros_like(motion.offsets)
    for joint, parent in enumerate(motion.parents.tolist()):
        rest[joint] = motion.offsets[joint] + (rest[parent] if parent >= 0 else 0.0)
    try:
        imported, notes = _stick_actor(path, motion, rest, mapping)
    except InputError:
        # the offsets of some programs are no pose of a person, but people stand in most clips
        standing = standing_pose(whole, rest, mapping.joints)
        turns = turns @ standing.turns.mT
        try:
            imported, notes = _stick_actor(path, standing.motion, standing.places, mapping)
        except InputError as error:
            raise InputError(
                f"{error} (its offsets are no pose of a person; frame {standing.frame}, the one "
                "nearest to standing in the file, was taken)"
            ) from None
        about = f"{path}: its rest pose is none of a person; frame {standing.frame} is taken"
        notes = (*notes, about)
    _require_bones(path, imported, mapping)
    bones = _bones(imported)
    found = _corrected(imported, turns[:, bones], places[:, bones], 1 / whole.frame_time, numbers)
    return replace(found, notes=(*told, *notes, *_odd_size(path, imported, mapping)))


def _odd_turns(path: Path, whole: BvhMotion, numbers: NDArray[np.int64]) -> Iterator[str]:
    """What rotations of a person's joints are not: radians taken for degrees, frames of zeros."""
    turns = whole.rotations[numbers]
    cosine = 0.5 * (np.trace(turns, axis1=-2, axis2=-1) - 1)
    angles = np.degrees(np.arccos(cosine.clip(-1, 1)))  # F J
    if 0 < angles.max() < _FULL_TURN and len(numbers) > _FEW:
        yield (
            f"{path}: no joint turns by more than {angles.max():.2g} degrees; are its rotations in "
            "radians? BVH has degrees"
        )
    rest = (angles[1:] < _NO_TURN).all(1)  # many begin with the rest pose
    if rest.any() and not rest.all():
        where = ranges(numbers[1:][rest].tolist())
        yield (
            f"{path}: rotations are all zero in frames {where}: the rest pose amid the motion; "
            "were frames lost there? Leave them out with --frames"
        )


def _cut_short(path: Path, frames: slice, count: int) -> Iterator[str]:
    if frames.stop is not None and frames.stop > count:
        yield f"{path}: ends after {count} frames; --frames asks for {frames.stop}"


def _stick_actor(
    path: Path, motion: BvhMotion, rest: Floats, mapping: ActorMapping
) -> tuple[ImportedActor, tuple[str, ...]]:
    """A figure of sticks at rest; in units of its own height where no unit makes it a person.

    Raises:
        InputError: its joints are not found, or it rests far from upright.
    """
    motion = with_feet(motion, rest)
    character = Character(stick_figure(motion, rest, path.stem), (), ())
    notes: tuple[str, ...] = ()
    try:
        imported = rig_character(character, mapping)
    except InputError as error:
        if mapping.metres_per_unit is not None or "units tall" not in str(error):
            raise
        size = float(np.ptp(character.template.vertices, axis=0).max())
        imported = rig_character(character, replace(mapping, metres_per_unit=_STATURE / size))
        notes = (
            f"{path}: its unit is not known; taken so that the figure is {_STATURE} m tall "
            "(metres_per_unit in a file given as --source-mapping states it)",
        )
    _require_pose(path, imported)
    return imported, notes


def _require_pose(path: Path, imported: ImportedActor) -> None:
    poses = [f for f in imported.about_actor if f.subject == "rest pose"]
    require_sound(path, tuple(f for f in poses if f.severity is Severity.ERROR))


def _require_bones(path: Path, imported: ImportedActor, mapping: ActorMapping) -> None:
    """Refuse a mapping of the source that crosses limbs or necks, or calls left what is right."""
    named = [f for f in imported.findings if f.subject in ("limbs", "trunk", "left and right")]
    require_sound(path, tuple(named) if mapping.joints else ())


def _odd_size(path: Path, imported: ImportedActor, mapping: ActorMapping) -> Iterator[str]:
    """A stated unit that makes the figure no person: where its feet stand is not found then."""
    height = float(np.ptp(imported.actor.template.vertices[:, 1]))
    if mapping.metres_per_unit is not None and not SHORTEST <= height <= TALLEST:
        yield (
            f"{path}: is {height:.3g} m tall with metres_per_unit = {mapping.metres_per_unit:g}, a "
            f"grown person {SHORTEST} to {TALLEST} m; correct it, or leave it out"
        )


def _of_character(path: Path, frames: slice, mapping: ActorMapping) -> MovingRig:
    document = open_document(path)
    character = read_character(document)
    imported = rig_character(character, mapping)
    _require_pose(path, imported)
    _require_bones(path, imported, mapping)
    bones = _bones(imported)
    clip = sample_clip(document, read_tree(document), np.array(character.nodes)[bones])
    numbers = np.arange(len(clip.world))[frames]
    _require_some(path, len(numbers), f"0 to {len(clip.world) - 1}")
    world = clip.world[numbers]
    turns = rigid(world.reshape(-1, 4, 4)).reshape(world.shape)[..., :3, :3]
    rest = character.template.bone_rest[bones, :3, :3]
    found = _corrected(imported, turns @ rest.mT, world[..., :3, 3], clip.rate, numbers)
    told = [f"{path}: {each}" for each in character.findings if each.severity is not Severity.INFO]
    told += [f"{path}: {note}" for note in clip.notes]
    told += _odd_size(path, imported, mapping)
    return replace(found, notes=(*told, *_cut_short(path, frames, len(clip.world))))


def _bones(imported: ImportedActor) -> list[int]:
    return [imported.bones.joints[name] for name in JOINTS]


def _corrected(
    imported: ImportedActor,
    rotation: Floats,
    position: Floats,
    rate: float,
    numbers: NDArray[np.int64],
) -> MovingRig:
    """Joints in metres and in the axes of the actor; the world's origin stays."""
    turn, scale = imported.correction.rotation, imported.correction.scale
    return MovingRig(
        actor=imported.actor,
        rotation=turn @ rotation @ turn.T,
        position=scale * position @ turn.T,
        rate=rate,
        frames=np.asarray(numbers, dtype=np.int64),
    )


def _require_some(path: Path, found: int, there: str) -> None:
    if not found:
        raise InputError(f"--frames: {path} holds frames {there}; expected a part of them")
