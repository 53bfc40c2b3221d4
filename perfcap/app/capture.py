"""``perfcap capture``: videos, cameras, detections and an actor to files of motion."""

from __future__ import annotations

import platform
import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import torch

from perfcap import __version__
from perfcap.actor.actor import Actor
from perfcap.app.console import progress_bars
from perfcap.app.inputs import Inputs, read_inputs
from perfcap.errors import InputError
from perfcap.io.actor import find_actor
from perfcap.io.gltf import load_template
from perfcap.pipeline.config import PRESETS
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.overlay import save_overlay
from perfcap.pipeline.performance import Performance, make_folder
from perfcap.pipeline.stage import Stage

_PACKAGES = ("torch", "kornia", "numpy", "numba", "opencv-python-headless", "av")
DONE, BAD_INPUT, INCOMPLETE = 0, 2, 3


@dataclass(frozen=True)
class CaptureRequest:
    """What the command line asks for; see ``perfcap capture --help``."""

    videos: tuple[Path, ...]
    actor: str
    cameras: Path
    detections: tuple[Path, ...]
    out: Path
    until: str = "track_motion"
    frames: str | None = None
    preset: str = "default"
    bones: str = "auto"
    video_map: Path | None = None
    detections_in: str = "calibration"
    device: str = "auto"
    overlay: bool = True
    resume: bool = False


def run_capture(request: CaptureRequest) -> int:
    """Capture and write everything; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    started = time.perf_counter()
    folder = make_folder(request.out)
    asked = describe(request)
    if request.resume and _finished(folder, asked):
        return DONE
    source = find_actor(request.actor)
    actor = Actor(load_template(source.path))
    inputs = read_inputs(
        request.videos,
        request.cameras,
        request.detections,
        frames=request.frames,
        video_map=request.video_map,
        detections_in_video=request.detections_in == "video",
    )
    like = torch.zeros((), dtype=torch.float64, device=_device(request.device))
    with progress_bars() as tell:
        performance = capture(
            actor,
            inputs.rig.cameras.to(like),
            inputs.detections.to(like),
            inputs.clip.fps,
            PRESETS[request.preset],
            until=Stage[request.until.upper()],
            solve_bones=_solve_bones(request.bones, source.generic, inputs.clip.views),
            progress=tell,
        )
        if request.overlay:
            save_overlay(
                folder / "overlay.mp4",
                performance,
                inputs.clip,
                inputs.pixel_map,
                lambda done, total: tell("overlay", done, total),
            )
    run = {"request": asked, "wall_s": time.perf_counter() - started, **environment(inputs)}
    performance.save(folder, inputs.clip.start, run)
    return DONE if performance.complete else INCOMPLETE


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
    del values["resume"]
    return {
        k: [str(p) for p in v] if isinstance(v, tuple) else str(v) if isinstance(v, Path) else v
        for k, v in values.items()
    }


def _finished(folder: Path, asked: dict[str, Any]) -> bool:
    """Whether the folder holds the complete result of the same request."""
    import json

    try:
        done = json.loads((folder / "run.json").read_text())
    except (OSError, ValueError):
        return False
    return bool(done.get("request") == asked and not done.get("not_captured"))


def _solve_bones(choice: str, generic: bool, views: int) -> bool:
    """``auto`` solves for an actor that is nobody in particular, where views show lengths."""
    return choice == "solve" or (choice == "auto" and generic and views > 1)


def _device(name: str) -> torch.device:
    if name == "auto":
        # windows are small: a CPU core solves them faster than a GPU launches them
        return torch.device("cpu")
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
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


def summary(performance: Performance, folder: Path) -> Sequence[str]:
    """What was made, for a person."""
    missing = sum(stop - start for start, stop in performance.gaps)
    lines = [f"{performance.frames} frames captured, files in {folder}"]
    if missing:
        lines.append(f"{missing} frames without a person were interpolated; see run.json")
    return lines
