"""``perfcap retarget``: motion of a capture, a BVH or an animated character on another actor."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from perfcap import __version__
from perfcap.actor.actor import Actor
from perfcap.app.capture_folder import named_people, spare_inputs, spare_others
from perfcap.app.console import PlainConsole
from perfcap.app.inputs import parse_frames
from perfcap.app.said import all_said, hearing
from perfcap.app.together import joints_of, level_rigs, on_their_floors, part_of
from perfcap.commands.results import Retarget
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.actor import find_actor, load_actor
from perfcap.io.actor_import import ActorMapping, read_mapping
from perfcap.io.atomic import writing
from perfcap.io.gltf_merge import merge_characters
from perfcap.io.made_folder import made_folder
from perfcap.io.moving_rig import MovingRig, read_moving_rig
from perfcap.io.result_folder import (
    REPORT,
    SCENE,
    finish,
    holds_result,
    person_folder,
    replacing,
    require_places,
    write_people,
)
from perfcap.pipeline.config import RetargetConfig
from perfcap.pipeline.joint_motion import JointMotion, leg_length
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.result_files import plain, write_result
from perfcap.pipeline.retarget_doubts import retarget_doubts
from perfcap.pipeline.retarget_scores import RetargetScores, retarget_scores
from perfcap.pipeline.retargeting import Retargeted, retarget
from perfcap.pipeline.surroundings import axis

_LOG = logging.getLogger(__name__)
_RATES = 5.0, 1000.0  # frames a second of recorded motion


@dataclass(frozen=True)
class _Part:
    """One person: from where, onto whom, what came of it, and what is odd about that."""

    name: str
    rig: MovingRig
    joints: JointMotion
    target: Actor
    found: Retargeted
    scores: RetargetScores
    about_target: tuple[str, ...]
    doubts: tuple[str, ...] = ()


def run_retarget(request: Retarget) -> int:
    """Solve and write a folder like that of a capture; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    with made_folder(request.out) as folder:
        finish(folder)
        spare_inputs(folder, _inputs(request), detected=False)
        require_places(folder)
        if holds_result(folder) and not request.overwrite:
            raise InputError(
                f"--out {folder}: holds a result already; add --overwrite to replace it, or choose "
                "another folder"
            )
        spare_others(folder, request.overwrite, detected=False)
        parts = _retargeted(request)
        with replacing(folder) as scratch:
            _write(request, scratch, parts)
    _tell(folder, parts)
    return 0


def _inputs(request: Retarget) -> list[Path]:
    given = [request.source, *(find_actor(name).path for name in request.actor)]
    files = [path for path in (request.mapping, request.source_mapping) if path is not None]
    inside = sorted(request.source.iterdir()) if request.source.is_dir() else []
    return [*given, *files, *inside]


def _retargeted(request: Retarget) -> list[_Part]:
    mapping = None if request.source_mapping is None else read_mapping(request.source_mapping)
    people = list(named_people(request.source)) if request.source.is_dir() else []
    people = people or [(request.source, "")]
    actors = [_target(name, request.mapping) for name in request.actor]
    if len(actors) not in (1, len(people)):
        raise InputError(
            f"--actor: {len(actors)} actors for {len(people)} people; expected one for all, or one "
            "each"
        )
    targets = actors * len(people) if len(actors) == 1 else actors
    rigs = [_read(request, place, mapping) for place, _ in people]
    wholes = rigs
    if request.frames is not None:  # the floor, and what is up, are those of the whole file
        wholes = [read_moving_rig(place, mapping=mapping) for place, _ in people]
    wholes = level_rigs(wholes)
    rigs = [part_of(whole, rig) for whole, rig in zip(wholes, rigs, strict=True)]
    ratios = [leg_length(t) / leg_length(r.actor) for (t, _), r in zip(targets, rigs, strict=True)]
    scale = sum(ratios) / len(ratios)  # one for all, so that people stay together
    config = _config(request)
    parts = [
        _solved(name, rig, whole, *target, scale, config)
        for (_, name), rig, whole, target in zip(people, rigs, wholes, targets, strict=True)
    ]
    placed = on_their_floors([(part.found, part.target) for part in parts])
    return [replace(part, found=found) for part, found in zip(parts, placed, strict=True)]


def _config(request: Retarget) -> RetargetConfig:
    config = RetargetConfig()
    if request.floor == "auto":
        return config
    return replace(config, contact=replace(config.contact, enabled=False))


def _target(name: str, mapping: Path | None) -> tuple[Actor, tuple[str, ...]]:
    """The actor of a name, and what was said of its file."""
    with hearing() as said:
        actor = load_actor(name, mapping, robots=True)
    return actor, tuple(said)


def _read(request: Retarget, place: Path, mapping: ActorMapping | None) -> MovingRig:
    with hearing() as said:
        rig = read_moving_rig(place, parse_frames(request.frames), mapping)
        for note in rig.notes:
            _LOG.warning("%s", note)
    return replace(rig, notes=tuple(said))


def _solved(
    name: str,
    rig: MovingRig,
    whole: MovingRig,
    target: Actor,
    about_target: tuple[str, ...],
    scale: float,
    config: RetargetConfig,
) -> _Part:
    joints = joints_of(rig)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", UserWarning)
        try:
            found = retarget(
                rig.actor,
                joints,
                target,
                rig.rate,
                config,
                scale,
                whole=joints_of(whole),
                examined=True,
            )
        finally:  # what is odd about the motion may be why it is refused
            notes = tuple(str(each.message) for each in told if each.category is UserWarning)
            for note in notes:
                _LOG.warning("%s", note)
    rig = replace(rig, notes=(*rig.notes, *notes))
    scores = retarget_scores(rig.actor, joints, target, found, rig.rate)
    part = _Part(name, rig, joints, target, found, scores, about_target)
    return replace(part, doubts=tuple(_doubts(part, grounded=config.contact.enabled)))


def _write(request: Retarget, folder: Path, parts: Sequence[_Part]) -> None:
    if len(parts) == 1 and not parts[0].name:
        _write_person(request, folder, parts[0])
        return
    names = [person_folder(number) for number in range(1, len(parts) + 1)]
    for name, part in zip(names, parts, strict=True):
        (folder / name).mkdir()
        _write_person(request, folder / name, part)
    merge_characters(folder / SCENE, {name: folder / name / "capture.glb" for name in names})
    write_people(folder, [{"actor": part.target.template.name} for part in parts])
    with writing(folder / "config.yaml") as file:
        file.write(yaml.safe_dump(plain(asdict(_config(request))), sort_keys=False).encode())
    with writing(folder / REPORT) as file:
        file.write(json.dumps(plain(_about(request)), indent=1).encode())


def _write_person(request: Retarget, folder: Path, part: _Part) -> None:
    found, like = part.found, part.found.motion.angles
    nobody = Detections.from_joints(
        like.new_zeros(found.motion.frames, 0, len(LANDMARKS), 2),
        like.new_zeros(found.motion.frames, 0, len(LANDMARKS)),
    )
    nowhere = Camera(like.new_zeros(0, 3, 3), like.new_zeros(0, 3, 3), like.new_zeros(0, 3))
    performance = Performance(
        part.target,
        nowhere,
        nobody,
        found.motion,
        part.rig.rate,
        _config(request),
        floor=found.floor,
        contact=found.contact,
        warnings=all_said(part.about_target, *part.rig.notes, *part.doubts),
    )
    scores = part.scores.report() | {"scale": found.scale}
    about = {**_about(request), **part.rig.about, "retarget": scores}
    if part.target.skeleton.rig.roles:
        skeleton = part.target.skeleton
        about["robot"] = {"root": skeleton.rig.joints[0], "joints": list(skeleton.angle_names)}
    write_result(performance, folder, int(part.rig.frames[0]), about, up=axis("y"))


def _about(request: Retarget) -> dict[str, Any]:
    given = {key: value for key, value in vars(request).items() if key != "overwrite"}
    return {"perfcap": __version__, "retargeted_from": str(request.source), "request": {
        key: str(value) if isinstance(value, Path) else value for key, value in given.items()
    }}  # fmt: skip


def _doubts(part: _Part, *, grounded: bool) -> Iterator[str]:
    """What no person does, and what no person can have done on this figure."""
    numbers = part.rig.frames.tolist()
    came = part.target, part.found, part.scores, part.rig.rate, numbers
    yield from retarget_doubts(*came, grounded=grounded, mapping="--source-mapping")
    if not _RATES[0] <= part.rig.rate <= _RATES[1]:
        yield f"the source runs at {part.rig.rate:.4g} frames a second; check its frame time"


def _tell(folder: Path, parts: Sequence[_Part]) -> None:
    console = PlainConsole(soft_wrap=True)
    for part in parts:
        kept = part.scores.report()
        limbs, reach = kept["limbs_degrees"], kept["reach_mm"]
        facing, trunk = kept["facing_degrees"], kept["trunk_degrees"]
        name = f"{part.name}: " if part.name else ""
        console.print(
            f"{name}{part.found.motion.frames} frames on {part.target.template.name}: limbs "
            f"{limbs['median']:.1f} degrees off (95 %: {limbs['q95']:.1f}), hips and shoulders "
            f"{facing['median']:.1f} ({facing['q95']:.1f}), trunk {trunk['median']:.1f} "
            f"({trunk['q95']:.1f}), wrists {reach['median']:.0f} mm ({reach['q95']:.0f})"
        )
        for line in part.doubts:
            _LOG.warning("%s%s", name, line)
    model = folder / (SCENE if len(parts) > 1 else "capture.glb")
    console.print(f"{model} opens in Blender; perfcap export {folder} writes other formats")
