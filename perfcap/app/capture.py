"""``perfcap capture``: videos, cameras, detections and an actor to files of motion."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from perfcap.actor.actor import Actor
from perfcap.app.auto_actor import AUTO, Casting, cast
from perfcap.app.capture_checks import check_actor, check_result, examined
from perfcap.app.capture_folder import last_change, spare_inputs
from perfcap.app.capture_work import Call, begin_work, drop_if_empty, find_work
from perfcap.app.console import PlainConsole, progress_bars
from perfcap.app.environment import environment
from perfcap.app.inputs import InputRequest, Inputs, read_inputs
from perfcap.app.networks import DETECTORS, LIFTERS, find_model
from perfcap.app.report import ReportRequest, write_report
from perfcap.app.true_views import ViewRequest, settled
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.io.actor_folder import MANIFEST
from perfcap.io.calibration.assumed import save_assumed
from perfcap.io.detections import save_detections
from perfcap.io.files import read_json
from perfcap.io.mask_files import view_folders
from perfcap.io.result import require_one_capture
from perfcap.io.result_folder import (
    ASSUMED_CAMERA,
    DETECTIONS,
    FILES,
    OVERLAY,
    PERSONAL,
    REPORT,
    SURFACE,
    TEXTURED,
    finish,
    holds_result,
    locked,
    own_file,
    replacing,
    require_places,
)
from perfcap.pipeline.bone_lengths import shows_bone_lengths
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.overlay import save_overlay, save_textured
from perfcap.pipeline.performance import Performance, make_folder
from perfcap.pipeline.presets import PRESETS, CaptureConfig
from perfcap.pipeline.result_files import write_result
from perfcap.pipeline.stage import Stage

DONE, INCOMPLETE = 0, 3

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CaptureRequest(InputRequest):
    """What the command line asks for; see ``perfcap capture --help``."""

    actor: str = AUTO
    height: float | None = None
    masks: tuple[Path, ...] = ()
    sync: str = "none"
    refine_cameras: bool = False
    out: Path
    until: str = "refine_surface"
    preset: str = "default"
    bones: str = "auto"
    floor: str = "auto"
    device: str = "auto"
    overlay: bool = True
    report: bool = False
    resume: bool = False
    overwrite: bool = False


def default_folder(videos: Sequence[Path]) -> Path:
    """Where a capture of these videos goes if nobody says: named after the first one."""
    name = videos[0].resolve().stem if videos else "perfcap"
    return Path(f"{name}_capture")


def point_to(folder: Path) -> None:
    """Say where the results are, in a last line."""
    picture = own_file(folder, OVERLAY)
    watch = "" if picture is None else f"watch {picture}; "
    line = f"{watch}{folder / 'capture.glb'} opens in Blender; perfcap view {folder} plays it"
    PlainConsole().print(line, soft_wrap=True)


def run_capture(request: CaptureRequest) -> int:
    """Capture and write everything; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    code = _capture(request)
    if request.report:
        write_report(ReportRequest(request.out, request.videos, request.cameras))
    return code


def _capture(request: CaptureRequest) -> int:
    folder = make_folder(request.out)
    with locked(folder):
        finish(folder)  # what a killed run had complete
        source = _casting(request).source()
        used = list(_used(request, source.path))
        spare_inputs(folder, used, detected=any(_networks(request)))
        require_places(folder)
        call = Call.of(describe(request), used)
        work = find_work(folder, call, request.resume, request.overwrite)
        if work is None:
            known = _known_result(folder, request, used)
            if known is not None:
                return known
            work = begin_work(folder, call, request.overwrite)
        try:
            return _run(request, folder, source.generic, work)
        finally:
            drop_if_empty(work)


def _run(request: CaptureRequest, folder: Path, generic: bool, work: Checkpoint) -> int:
    started = time.perf_counter()
    images, detected = Stage[request.until.upper()].needs_images, bool(request.detectors)
    wrong = ViewRequest(request.sync, request.refine_cameras)
    given = read_inputs(request, work)
    inputs, views = settled(given, wrong)
    inputs = examined(inputs, needs_images=images, detected=detected)
    with progress_bars() as tell:
        chosen = cast(_casting(request), inputs, tell)
    require_places(folder, view_folders(list(inputs.rig.names)))
    solve_bones = _solve_bones(request.bones, generic, inputs.detections)
    told = check_actor(inputs, chosen.actor, solve_bones)
    performance = _perform(request, chosen.actor, inputs, solve_bones, work)
    more = (*performance.warnings, *told, *check_result(performance))
    performance = replace(performance, lost=inputs.lost, warnings=more)
    with replacing(folder, last=True) as scratch:
        _draw(request, scratch, performance, inputs)
        chosen.save(scratch)
        if any(_networks(request)):
            _save_detections(scratch, given)
        if request.cameras is None:
            seen = inputs.rig.names, inputs.clip.fps
            save_assumed(scratch / ASSUMED_CAMERA, performance.cameras, *seen)
        wall = time.perf_counter() - started
        run = {"request": describe(request), "wall_s": wall, **environment(inputs)}
        run |= {"view_errors": views} if views else {}
        write_result(performance, scratch, inputs.clip.start, run, inputs.rig.names)
    made_up, trust = _made_up(performance, inputs.clip.start), performance.trust
    untrusted = trust.sentences(inputs.clip.start) if trust else ()
    for line in (*chosen.warnings, *performance.warnings, *made_up, *untrusted):
        _LOG.warning("%s", line)
    return DONE if performance.complete and performance.trusted else INCOMPLETE


def _casting(request: CaptureRequest) -> Casting:
    look = Stage[request.until.upper()].needs_images
    return Casting(request.actor, request.height, request.masks, look, request.preset)


def _used(request: CaptureRequest, actor: Path) -> Iterator[Path]:
    """Files and folders that a request reads."""
    yield from (*request.videos, *request.detections, *request.masks, actor)
    if request.cameras is not None:
        yield request.cameras
    manifest = actor.with_name(MANIFEST)
    if manifest.is_file():
        yield manifest
    if request.video_map is not None:
        yield request.video_map
    yield from _networks(request)


def _networks(request: CaptureRequest) -> Iterator[Path]:
    """Folders of the networks that a request uses."""
    for names, kind in ((request.detectors, DETECTORS), (request.lifters, LIFTERS)):
        for name in names:
            yield find_model(name, kind)


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
    request: CaptureRequest, actor: Actor, inputs: Inputs, solve_bones: bool, work: Checkpoint
) -> Performance:
    # stages that look at images run a thread a core; more inside each would only be in the way
    torch.set_num_threads(1)
    like = torch.zeros((), dtype=torch.float64, device=_device(request.device))
    cameras = inputs.pixel_map.cameras(inputs.rig.cameras, inputs.clip.sizes)
    with progress_bars() as tell:
        performance = capture(
            actor,
            inputs.rig.cameras.to(like),
            inputs.detections.to(like),
            inputs.clip.fps,
            _settings(request),
            images=Images(inputs.clip, cameras),
            until=Stage[request.until.upper()],
            solve_bones=solve_bones,
            level=request.cameras is None,
            progress=tell,
            checkpoint=work,
        )
    return performance.to(like.cpu())


def _settings(request: CaptureRequest) -> CaptureConfig:
    """The preset, without contact and floor where the request says so."""
    preset = PRESETS[request.preset]
    if request.floor == "auto":
        return preset
    contact = replace(preset.pose.contact, enabled=False)
    return replace(preset, pose=replace(preset.pose, contact=contact))


def _draw(request: CaptureRequest, folder: Path, performance: Performance, inputs: Inputs) -> None:
    """The videos that a request asks for."""
    with progress_bars() as tell:
        for name, save in _videos(request).items():
            save(
                folder / name,
                performance,
                inputs.clip,
                inputs.pixel_map,
                partial(tell, name.removesuffix(".mp4")),
            )


def _videos(request: CaptureRequest) -> dict[str, Callable[..., None]]:
    """The videos that a request asks for, and what draws them."""
    if not request.overlay:
        return {}
    if not Stage[request.until.upper()].needs_images:
        return {OVERLAY: save_overlay}
    return {OVERLAY: save_overlay, TEXTURED: save_textured}


def describe(request: CaptureRequest) -> dict[str, Any]:
    """The request as plain values."""
    values = {k: getattr(request, k) for k in request.__dataclass_fields__}
    del values["resume"], values["report"], values["overwrite"]
    return {
        k: [str(p) for p in v] if isinstance(v, tuple) else str(v) if isinstance(v, Path) else v
        for k, v in values.items()
    }


def _known_result(folder: Path, request: CaptureRequest, used: Iterable[Path]) -> int | None:
    """Exit code of the result of this very call, where ``--resume`` finds it; None of no result.

    Raises:
        InputError: another result lies there, and may not be overwritten.
    """
    if not holds_result(folder):
        return None
    known = _finished(folder, request, used) if request.resume else None
    if known is None and not request.overwrite:
        whose = "of another call, or of inputs that have changed since" if request.resume else ""
        raise InputError(
            f"--out {folder}: holds a result already{whose and f', {whose}'}; add --overwrite to "
            "replace it, or choose another folder"
        )
    return known


def _finished(folder: Path, request: CaptureRequest, used: Iterable[Path]) -> int | None:
    """Exit code of the whole result of the same request on the same files."""
    try:
        require_one_capture(folder)
        done = read_json(folder / REPORT, "the report of a capture")
        written = (folder / REPORT).stat().st_mtime
        changed = any(last_change(path) > written for path in used)
    except (OSError, InputError):
        return None
    expected = (*FILES, *_videos(request))
    expected += (DETECTIONS,) if any(_networks(request)) else ()
    expected += PERSONAL if request.actor == AUTO else ()
    expected += (SURFACE,) if Stage[request.until.upper()].needs_images else ()
    same = isinstance(done, dict) and done.get("request") == describe(request)
    there = all(own_file(folder, name) is not None for name in expected)
    if not same or not there or changed:
        return None
    quality = done.get("quality")
    trusted = isinstance(quality, dict) and quality.get("trusted") is True
    return DONE if done.get("complete") is True and trusted else INCOMPLETE


def _solve_bones(choice: str, generic: bool, detections: Detections) -> bool:
    """``auto`` solves for an actor that is nobody in particular, where views show lengths."""
    return choice == "solve" or (choice == "auto" and generic and shows_bone_lengths(detections))


def _device(name: str) -> torch.device:
    if name == "auto":
        # windows are small: a CPU core solves them faster than a GPU launches them
        return torch.device("cpu")
    try:
        device = torch.device(name)
        torch.zeros(1, dtype=torch.float64, device=device).item()
    except (RuntimeError, AssertionError, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"--device {name}: cannot be used ({reason}); try cpu") from None
    return device


def _made_up(performance: Performance, first: int) -> Iterator[str]:
    """Frames without a capture, for a person; ``first`` is the number of the first frame."""
    for start, stop in performance.gaps:
        yield (
            f"frames {first + start} to {first + stop - 1}: nobody is detected; they are "
            "interpolated"
        )
    if performance.lost:
        start, stop = first + performance.frames, first + performance.frames + performance.lost
        yield f"frames {start} to {stop - 1}: are missing in the video or its detections"
