"""``perfcap capture``: videos, cameras, detections and an actor to files of motion."""

from __future__ import annotations

import json
import logging
import platform
import resource
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import torch

from perfcap import __version__
from perfcap.actor.actor import Actor
from perfcap.app.capture_folder import (
    DETECTIONS,
    OVERLAY,
    TEXTURED,
    last_change,
    remove_older,
    spare_inputs,
)
from perfcap.app.console import progress_bars
from perfcap.app.inputs import InputRequest, Inputs, read_inputs
from perfcap.app.networks import DETECTORS, LIFTERS, find_model
from perfcap.app.report import ReportRequest, write_report
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.io.actor import find_actor, load_actor
from perfcap.io.actor_folder import MANIFEST
from perfcap.io.detections import save_detections
from perfcap.pipeline.bone_lengths import shows_bone_lengths
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.overlay import save_overlay, save_textured
from perfcap.pipeline.performance import FILES, REPORT, SURFACE, Performance, make_folder
from perfcap.pipeline.presets import PRESETS
from perfcap.pipeline.stage import Stage

_PACKAGES = ("torch", "kornia", "numpy", "numba", "opencv-python-headless", "av")
DONE, INCOMPLETE = 0, 3

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CaptureRequest(InputRequest):
    """What the command line asks for; see ``perfcap capture --help``."""

    actor: str
    out: Path
    until: str = "refine_surface"
    preset: str = "default"
    bones: str = "auto"
    device: str = "auto"
    overlay: bool = True
    report: bool = False
    resume: bool = False


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
    started = time.perf_counter()
    folder = make_folder(request.out)
    source = find_actor(request.actor)
    used = list(_used(request, source.path))
    spare_inputs(folder, used, detected=any(_networks(request)))
    if request.resume and _finished(folder, request, used):
        return DONE
    actor = load_actor(request.actor)
    inputs = read_inputs(request)
    solve_bones = _solve_bones(request.bones, source.generic, inputs.detections)
    performance = replace(_perform(request, folder, actor, inputs, solve_bones), lost=inputs.lost)
    wall = time.perf_counter() - started
    run = {"request": describe(request), "wall_s": wall, **environment(inputs)}
    if any(_networks(request)):
        _save_detections(folder, inputs)
    performance.save(folder, inputs.clip.start, run, inputs.rig.names)
    for line in (
        *inputs.warnings,
        *performance.warnings,
        *_made_up(performance, inputs.clip.start),
    ):
        _LOG.warning("%s", line)
    return DONE if performance.complete else INCOMPLETE


def _used(request: CaptureRequest, actor: Path) -> Iterator[Path]:
    """Files and folders that a request reads."""
    yield from (*request.videos, request.cameras, *request.detections, actor)
    manifest = actor.with_name(MANIFEST)
    if manifest.is_file():
        yield manifest
    if request.video_map is not None:
        yield request.video_map
    yield from _networks(request)


def _networks(request: CaptureRequest) -> Iterator[Path]:
    """Folders of the networks that a request uses."""
    for name, kind in ((request.detector, DETECTORS), (request.lifter, LIFTERS)):
        if name is not None:
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
    request: CaptureRequest, folder: Path, actor: Actor, inputs: Inputs, solve_bones: bool
) -> Performance:
    """Capture and, if wanted, draw; the folder no longer tells of an older result."""
    # stages that look at images run a thread a core; more inside each would only be in the way
    torch.set_num_threads(1)
    like = torch.zeros((), dtype=torch.float64, device=_device(request.device))
    until = Stage[request.until.upper()]
    cameras = inputs.pixel_map.cameras(inputs.rig.cameras, inputs.clip.sizes)
    with progress_bars() as tell:
        performance = capture(
            actor,
            inputs.rig.cameras.to(like),
            inputs.detections.to(like),
            inputs.clip.fps,
            PRESETS[request.preset],
            images=Images(inputs.clip, cameras),
            until=until,
            solve_bones=solve_bones,
            progress=tell,
        )
        performance = performance.to(like.cpu())
        videos = _videos(request)
        remove_older(folder, videos)
        for name, save in videos.items():
            save(
                folder / name,
                performance,
                inputs.clip,
                inputs.pixel_map,
                partial(tell, name.removesuffix(".mp4")),
            )
    return performance


def _videos(request: CaptureRequest) -> dict[str, Callable[..., None]]:
    """The videos that a request asks for, and what draws them."""
    if not request.overlay:
        return {}
    if not Stage[request.until.upper()].needs_images:
        return {OVERLAY: save_overlay}
    return {OVERLAY: save_overlay, TEXTURED: save_textured}


def environment(inputs: Inputs) -> dict[str, Any]:
    """Versions, machine, memory and what reading the inputs had to say."""
    return {
        "perfcap": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(terse=True),
        "packages": {name: _version(name) for name in _PACKAGES},
        "peak_memory_mib": _peak_memory_mib(),
        "views": list(inputs.rig.names),
        "input_warnings": list(inputs.warnings),
    }


def describe(request: CaptureRequest) -> dict[str, Any]:
    """The request as plain values."""
    values = {k: getattr(request, k) for k in request.__dataclass_fields__}
    del values["resume"], values["report"]
    return {
        k: [str(p) for p in v] if isinstance(v, tuple) else str(v) if isinstance(v, Path) else v
        for k, v in values.items()
    }


def _finished(folder: Path, request: CaptureRequest, used: Iterable[Path]) -> bool:
    """Whether the folder holds the complete result of the same request on the same files."""
    try:
        done = json.loads((folder / REPORT).read_text(encoding="utf-8"))
        written = (folder / REPORT).stat().st_mtime
        changed = any(last_change(path) > written for path in used)
    except (OSError, ValueError):
        return False
    expected = (*FILES, *_videos(request))
    expected += (DETECTIONS,) if any(_networks(request)) else ()
    expected += (SURFACE,) if Stage[request.until.upper()].needs_images else ()
    same = isinstance(done, dict) and done.get("request") == describe(request)
    there = all((folder / name).is_file() for name in expected)
    return same and done["complete"] is True and there and not changed


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


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _peak_memory_mib() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024**2 if sys.platform == "darwin" else 1024)


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
