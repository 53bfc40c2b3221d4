"""The files of several captured people: a folder each, and what they share."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
import yaml

from perfcap.app.auto_actor import Cast
from perfcap.app.capture_request import describe, environment, networks_of
from perfcap.app.console import progress_bars
from perfcap.app.inputs import Inputs
from perfcap.app.match_people import Matching
from perfcap.commands.capture import Capture
from perfcap.detect.association import BONE_NAMES, Association, tracked_bones
from perfcap.io.atomic import writing
from perfcap.io.detections import save_candidates, save_detections
from perfcap.io.gltf_merge import merge_characters
from perfcap.io.mask_files import save_masks
from perfcap.io.result_folder import (
    DETECTIONS,
    MASKS,
    OVERLAY,
    REPORT,
    SCENE,
    person_folder,
    write_people,
)
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.overlay import save_people_overlay
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.result_files import plain, write_result


@dataclass(frozen=True)
class CapturedScene:
    """Several people, and how they were told apart.

    Attributes:
        people: captures of K people.
        cast: their actors.
        inputs: with detections of everybody.
        found: who is who.
        matching: who plays whom.
        notes: what a user should know of all of them.
    """

    people: tuple[Performance, ...]
    cast: tuple[Cast, ...]
    inputs: Inputs
    found: Association
    matching: Matching
    notes: tuple[str, ...]


def write_scene(
    request: Capture, folder: Path, scene: CapturedScene, started: float, work: Checkpoint
) -> None:
    """Write everybody's result and what they share into an empty folder; run.json comes last.

    Args:
        request: of the capture.
        folder: exists.
        scene: what was captured.
        started: ``time.perf_counter`` when it began.
        work: what is drawn already.

    Raises:
        InputError: the folder cannot be written.
    """
    inputs = scene.inputs
    about = environment(inputs)
    for number in range(1, len(scene.people) + 1):
        _write_person(request, folder, scene, number, {**about, "person": number})
    names = [person_folder(number) for number in range(1, len(scene.people) + 1)]
    merge_characters(folder / SCENE, {name: folder / name / "capture.glb" for name in names})
    if any(networks_of(request)):
        save_candidates(folder / DETECTIONS, inputs.detections, **_kept(inputs))
    if request.overlay:
        with progress_bars() as tell:
            shown = inputs.clip, inputs.pixel_map, partial(tell, "overlay"), work.kept("overlay")
            save_people_overlay(folder / OVERLAY, scene.people, *shown)
    _write_masks(folder, scene)
    write_people(folder, _who(request, scene))
    with writing(folder / "config.yaml") as file:
        settings = plain(asdict(scene.people[0].config))
        file.write(yaml.safe_dump(settings, sort_keys=False).encode())
    report = {"request": describe(request), "wall_s": time.perf_counter() - started, **about}
    with writing(folder / REPORT) as file:
        file.write(json.dumps(plain(report | _summary(scene)), indent=1).encode())


def _write_person(
    request: Capture,
    folder: Path,
    scene: CapturedScene,
    number: int,
    about: Mapping[str, Any],
) -> None:
    """A result as of this person alone: their actor, their detections beside it."""
    inputs, performance = scene.inputs, scene.people[number - 1]
    place = folder / person_folder(number)
    place.mkdir()
    scene.cast[number - 1].save(place)
    save_detections(place / DETECTIONS, performance.detections, **_kept(inputs))
    own = describe(request) | {
        "actor": _actor(request, number),
        "detections": [],
        "detections_in": "calibration",
        "out": str(request.folder / person_folder(number)),
    }
    run = {"request": own, **about}
    write_result(performance, place, inputs.clip.start, run, inputs.rig.names)


def _write_masks(folder: Path, scene: CapturedScene) -> None:
    """Who is where in every view, where images were looked at."""
    refinement = scene.people[0].refinement
    if refinement is None:
        return
    everybody = replace(refinement.evidence.silhouettes, person=None)
    names = scene.inputs.rig.names
    masks = {name: everybody.png(view) for view, name in enumerate(names)}
    save_masks(folder / MASKS, masks, scene.inputs.clip.start)


def _actor(request: Capture, number: int) -> str:
    return request.actor[(number - 1) % len(request.actor)]


def _kept(inputs: Inputs) -> dict[str, Any]:
    """How detections are written, so that they are those of the video's frames and pixels."""
    return {
        "views": inputs.rig.names,
        "start": inputs.clip.start,
        "pixel_offset": inputs.rig.pixel_offset,
        "video_frames": inputs.clip.total,
    }


def _who(request: Capture, scene: CapturedScene) -> list[dict[str, Any]]:
    """What people.json says of each."""
    listed = []
    bones = tracked_bones(scene.found.points)
    for number, track in enumerate(scene.matching.tracks, 1):
        slots, margin = scene.found.slots[track], scene.found.margin[track]
        close = margin[margin.isfinite()]
        own: dict[str, Any] = {
            "actor": _actor(request, number),
            "track": track,
            "frames_seen": int((slots >= 0).any(-1).sum()),
            "views_a_frame": round(float((slots >= 0).sum(-1).double().mean()), 2),
            "bones_m": dict(zip(BONE_NAMES, _rounded(bones[track]), strict=True)),
        }
        if scene.matching.difference:
            own["bones_differ"] = round(scene.matching.difference[number - 1], 4)
            own["bones_margin"] = _finite(scene.matching.margin[number - 1])
        if len(close):
            low, middle = torch.quantile(close, torch.tensor([0.01, 0.5]).to(close)).tolist()
            own["identity_margin_m"] = {"lowest_percent": round(low, 3), "median": round(middle, 3)}
        listed.append(own)
    return listed


def _rounded(values: torch.Tensor) -> list[float | None]:
    return [_finite(value) for value in values.tolist()]


def _finite(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None


def _summary(scene: CapturedScene) -> dict[str, Any]:
    """What run.json says of all of them."""
    people = scene.people
    stages: dict[str, dict[str, float]] = {}
    for each in people:
        for stage in each.stages:
            sums = stages.setdefault(stage.name, {"wall_s": 0.0, "cpu_s": 0.0})
            sums["wall_s"] += stage.wall
            sums["cpu_s"] += stage.cpu
    return {
        "people": len(people),
        "frames": people[0].frames,
        "fps": people[0].rate,
        "complete": all(each.complete for each in people),
        "quality": {"trusted": all(each.trusted for each in people)},
        "stages": stages,
        "warnings": list(scene.notes),
    }
