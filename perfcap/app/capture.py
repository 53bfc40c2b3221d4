"""``perfcap capture``: videos, cameras, detections and an actor to files of motion."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

from perfcap.actor.actor import Actor
from perfcap.app.auto_actor import cast
from perfcap.app.capture_checks import made_up, wants_bones
from perfcap.app.capture_folder import spare_inputs, spare_others, states_of, unchanged
from perfcap.app.capture_inputs import made_ready
from perfcap.app.capture_people import Crowd, check_people, find_people, run_people
from perfcap.app.capture_request import (
    casting_of,
    describe,
    edge_network,
    environment,
    find_device,
    keeps_detections,
    named_doubts,
    segmenter_of,
    settings_of,
    used_files,
    uses_masks,
)
from perfcap.app.capture_work import Call, begin_work, drop_if_empty, find_work
from perfcap.app.console import PlainConsole, progress_bars
from perfcap.app.inputs import Inputs, read_inputs
from perfcap.app.memory_budget import threads_within
from perfcap.app.project import in_project
from perfcap.app.report import write_people_report, write_report
from perfcap.app.said import all_said, hearing
from perfcap.commands.capture import AUTO, Capture
from perfcap.commands.results import Report
from perfcap.detect.segmenter import OnnxSegmenter
from perfcap.errors import InputError
from perfcap.io.actor import load_actor
from perfcap.io.calibration.assumed import save_assumed
from perfcap.io.detections import save_detections
from perfcap.io.files import read_json
from perfcap.io.made_folder import made_folder
from perfcap.io.mask_files import MaskFolders, view_folders
from perfcap.io.result import require_one_capture
from perfcap.io.result_folder import (
    ASSUMED_CAMERA,
    DETECTIONS,
    FILES,
    OVERLAY,
    PERSONAL,
    REPORT,
    SCENE,
    SURFACE,
    TEXTURED,
    finish,
    holds_result,
    is_several,
    own_file,
    people_of,
    replacing,
    require_places,
)
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.overlay import save_overlay, save_textured
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.result_files import write_result
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.surroundings import axis

DONE, INCOMPLETE = 0, 3

_LOG = logging.getLogger(__name__)


def point_to(folder: Path) -> None:
    """Say where the results are, in a last line."""
    picture = own_file(folder, OVERLAY)
    watch = "" if picture is None else f"watch {picture}; "
    model = folder / (SCENE if is_several(folder) else "capture.glb")
    line = f"{watch}{model} opens in Blender; perfcap view {folder} plays it"
    PlainConsole().print(line, soft_wrap=True)


def run_capture(request: Capture) -> int:
    """Capture and write everything; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    request = in_project(replace(request, out=request.folder))  # a project has other videos
    code = _capture(request)
    if request.report:
        for folder in people_of(request.folder):
            write_report(Report(folder, request.videos, request.cameras))
        if is_several(request.folder):
            write_people_report(Report(request.folder, request.videos, request.cameras))
    return code


def _capture(request: Capture) -> int:
    with made_folder(request.folder) as folder:
        finish(folder)  # what a killed run had complete
        check_people(request)
        uses_masks(request)
        sources = [casting_of(request, name).source() for name in request.actor]
        used = list(used_files(request, (source.path for source in sources)))
        spare_inputs(folder, used, detected=keeps_detections(request))
        require_places(folder)
        call = Call.of(describe(request), states_of(used))
        work = find_work(folder, call, request.resume, request.overwrite)
        if work is None:
            known = _known_result(folder, request, call)
            if known is not None:
                return known
            spare_others(folder, request.overwrite, detected=keeps_detections(request))
            work = begin_work(folder, call, request.overwrite)
        try:
            with hearing() as said:
                generic = [source.generic for source in sources]
                return _run(request, folder, generic, work, call, said)
        finally:
            drop_if_empty(work)


def _run(
    request: Capture,
    folder: Path,
    generic: Sequence[bool],
    work: Checkpoint,
    call: Call,
    said: Sequence[str],
) -> int:
    started = time.perf_counter()
    # one that cannot be read is told before people are looked for
    actors = {name: load_actor(name) for name in request.actor if name != AUTO}
    inputs = replace(read_inputs(request, work), files=call.inputs)
    workers = threads_within(request.memory, inputs.clip.sizes)
    everybody = None
    if request.everybody:
        found = find_people(request, inputs, list(actors.values()), generic)
        if len(found.people) > 1:
            told_of = (*inputs.warnings, *named_doubts(request, inputs.clip.views))
            crowd = Crowd(replace(inputs, warnings=told_of), found, generic, actors)
            good = run_people(request, folder, crowd, work, said)
            return DONE if good else INCOMPLETE
        everybody, told_of = inputs.detections, (*inputs.warnings, *found.notes)
        inputs = replace(inputs, detections=found.people[0], warnings=told_of)
    given, ready = inputs, made_ready(request, inputs, everybody)
    inputs = ready.inputs
    casting = replace(casting_of(request, request.actor[0]), loaded=actors.get(request.actor[0]))
    with progress_bars() as tell:
        chosen = cast(casting, inputs, tell, work)
    require_places(folder, view_folders(list(inputs.rig.names)))
    solve_bones = wants_bones(request.bones, generic[0], inputs.detections)
    performance = _perform(request, chosen.actor, inputs, ready.masks, solve_bones, workers, work)
    performance = replace(performance, lost=inputs.lost)
    performance = chosen.dress(performance, inputs)
    with replacing(folder, last=True) as scratch:
        _draw(request, scratch, performance, inputs, work)
        chosen.save(scratch)
        if keeps_detections(request):
            _save_detections(scratch, given)
        if request.cameras is None:
            seen = inputs.rig.names, inputs.clip.fps
            first = inputs.clip.start
            save_assumed(scratch / ASSUMED_CAMERA, performance.cameras, *seen, first)
        wall = time.perf_counter() - started
        about = replace(inputs, warnings=all_said(said, *inputs.warnings, *chosen.warnings))
        run = {"request": describe(request), "wall_s": wall, **environment(about)}
        run |= {"view_errors": ready.views} if ready.views else {}
        clip, up = inputs.clip, axis("y") if request.cameras is None else None  # of a level world
        late = {name: clip.late(view) for view, name in enumerate(inputs.rig.names)}
        run |= {"late_frames": late} if any(late.values()) else {}  # of masks, as they are numbered
        own = [clip.file_frames(view).tolist() for view in range(clip.views)]
        write_result(performance, scratch, clip.start, run, inputs.rig.names, up, own)
    gaps, trust = made_up(performance, inputs.clip.start), performance.trust
    untrusted = trust.sentences(inputs.clip.start) if trust else ()
    for line in (*chosen.warnings, *performance.warnings, *gaps, *untrusted):
        _LOG.warning("%s", line)
    return DONE if performance.complete and performance.trusted else INCOMPLETE


def _save_detections(folder: Path, inputs: Inputs) -> None:
    """What was detected, as a later ``--detections`` reads it."""
    save_detections(
        folder / DETECTIONS,
        inputs.detections,
        inputs.rig.names,
        start=inputs.clip.start,
        pixel_offset=inputs.rig.pixel_offset,
        video_frames=inputs.clip.total,
    )


def _perform(
    request: Capture,
    actor: Actor,
    inputs: Inputs,
    masks: MaskFolders | None,
    solve_bones: bool,
    workers: int | None,
    work: Checkpoint,
) -> Performance:
    # stages that look at images run a thread a core; more inside each would only be in the way
    torch.set_num_threads(1)
    like = torch.zeros((), dtype=torch.float64, device=find_device(request.device))
    cameras = inputs.pixel_map.cameras(inputs.rig.cameras, inputs.clip.sizes)
    manifest = segmenter_of(request)
    segmenter = None if manifest is None else OnnxSegmenter(manifest)
    with progress_bars() as tell:
        performance = capture(
            actor,
            inputs.rig.cameras.to(like),
            inputs.detections.to(like),
            inputs.clip.fps,
            settings_of(request),
            images=Images(
                inputs.clip,
                cameras,
                segmenter,
                masks,
                examined=True,
                lag=inputs.lag,
                edges=edge_network(request),
            ),
            until=Stage[request.until.upper()],
            solve_bones=solve_bones,
            level=request.cameras is None,
            up=inputs.up,
            workers=workers,
            progress=tell,
            checkpoint=work,
        )
    return performance.to(like.cpu())


def _draw(
    request: Capture,
    folder: Path,
    performance: Performance,
    inputs: Inputs,
    work: Checkpoint,
) -> None:
    """The videos that a request asks for."""
    with progress_bars() as tell:
        for name, save in _videos(request).items():
            save(
                folder / name,
                performance,
                inputs.clip,
                inputs.pixel_map,
                partial(tell, name.removesuffix(".mp4")),
                work.kept(name.removesuffix(".mp4")),
            )


def _videos(request: Capture) -> dict[str, Callable[..., None]]:
    """The videos that a request asks for, and what draws them."""
    if not request.overlay:
        return {}
    if not Stage[request.until.upper()].needs_images:
        return {OVERLAY: save_overlay}
    return {OVERLAY: save_overlay, TEXTURED: save_textured}


def _known_result(folder: Path, request: Capture, call: Call) -> int | None:
    """Exit code of the result of this very call, where ``--resume`` finds it; None of no result.

    Raises:
        InputError: another result lies there, and may not be overwritten.
    """
    if not holds_result(folder):
        return None
    known = _finished(folder, request, call) if request.resume else None
    if known is None and not request.overwrite:
        whose = "of another call, or of inputs that have changed since" if request.resume else ""
        raise InputError(
            f"--out {folder}: holds a result already{whose and f', {whose}'}; add --overwrite to "
            "replace it, or choose another folder"
        )
    return known


def _expected(request: Capture, folder: Path) -> tuple[str, ...]:
    """Files of a whole result of this request."""
    surface = (SURFACE,) if Stage[request.until.upper()].needs_images else ()
    if is_several(folder):
        own = (*FILES, *surface)
        names = [f"{place.name}/{name}" for place in people_of(folder) for name in own]
        found = (DETECTIONS,) if request.detectors else ()
        return (*names, SCENE, *((OVERLAY,) if request.overlay else ()), *found)
    found = (DETECTIONS,) if keeps_detections(request) else ()
    body = PERSONAL if request.actor == (AUTO,) else ()
    return (*FILES, *_videos(request), *found, *body, *surface)


def _finished(folder: Path, request: Capture, call: Call) -> int | None:
    """Exit code of the whole result of the same request on the same files."""
    try:
        require_one_capture(folder)
        done = read_json(folder / REPORT, "the report of a capture")
    except InputError:
        return None
    if not isinstance(done, dict) or done.get("request") != describe(request):
        return None
    there = all(own_file(folder, name) is not None for name in _expected(request, folder))
    if not there or not unchanged(done.get("input_files"), call.inputs):
        return None
    quality = done.get("quality")
    trusted = isinstance(quality, dict) and quality.get("trusted") is True
    return DONE if done.get("complete") is True and trusted else INCOMPLETE
