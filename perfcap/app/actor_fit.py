"""``perfcap actor fit``: an actor with the body of a person who is seen by calibrated cameras."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch
from rich.console import Console

from perfcap.actor.actor import Actor
from perfcap.app.actor_inspect import run_inspect
from perfcap.app.console import progress_bars
from perfcap.app.fit_sheet import FIT_SHEET, save_fit_sheet
from perfcap.app.fit_views import ChosenFrames, choose_frames, fit_person, read_masks
from perfcap.app.inputs import Inputs, lift_inputs, read_inputs
from perfcap.app.measures import print_measures, save_measures
from perfcap.app.networks import DETECTORS, LIFTERS, Detecting, find_model, parse_boxes
from perfcap.detect.lifter import OnnxLifter
from perfcap.detect.onnx import OnnxDetector
from perfcap.errors import InputError
from perfcap.io.actor_folder import MANIFEST, save_actor
from perfcap.io.body_model import DEFAULT_BODY, load_body_model
from perfcap.rigging import BodyFit, Person

_LEAST = 3  # joints a frame: fewer fix no pose
_DOUBTFUL = 0.03  # metres of deviation of the height above which it is told

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class FitRequest:
    """What the command line asks for; see ``perfcap actor fit --help``."""

    videos: tuple[Path, ...]
    cameras: Path
    out: Path
    detections: tuple[Path, ...] = ()
    detector: str | None = None
    box: tuple[float, ...] = ()
    lifter: str | None = None
    masks: tuple[Path, ...] = ()
    silhouettes: bool = True
    height: float | None = None
    frames: str | None = None
    count: int = 12
    name: str | None = None
    body_model: str = DEFAULT_BODY
    video_map: Path | None = None
    detections_in: str = "calibration"


def run_fit(request: FitRequest) -> int:
    """Fit, write the actor's folder and show what is in it; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    torch.set_num_threads(1)  # stages that look at images run a thread a core
    _check(request)
    model = load_body_model(request.body_model)
    inputs = _read(request)
    chosen = choose_frames(inputs, request.count)
    masks = read_masks(chosen, request.masks) if request.masks else None
    fit, masks = fit_person(model, chosen, request.height, masks, request.silhouettes)
    template = replace(fit.template, name=request.name or request.out.name).rounded()
    source = _source(chosen, masks is not None)
    save_actor(Actor(template), request.out, licence=model.rig.licence, provenance=source)
    save_measures(request.out, fit.measurements, fit.deviations, source)
    save_fit_sheet(request.out / FIT_SHEET, model, fit, chosen)
    code = run_inspect(str(request.out), None, request.out)
    print_measures(fit.measurements, fit.deviations)
    for line in (*inputs.warnings, *_doubts(request, fit, inputs.clip.views)):
        _LOG.warning("%s", line)
    console = Console()
    console.print(f"look at {request.out / FIT_SHEET}", soft_wrap=True, markup=False)
    console.print(f"capture with --actor {request.out}", soft_wrap=True, markup=False)
    return code


def _check(request: FitRequest) -> None:
    if request.out.exists() and not request.out.is_dir():
        raise InputError(f"--out {request.out}: is a file; expected a folder for {MANIFEST}")
    if bool(request.detections) == (request.detector is not None):
        given = "and --detector are both given" if request.detections else "is missing"
        raise InputError(
            f"--detections: {given}; expected files of joints, or --detector MODEL to find them in "
            "the videos"
        )
    if request.box and request.detector is None:
        raise InputError("--box: is for --detector; expected no box with --detections")
    if request.masks and not request.silhouettes:
        raise InputError("--masks: are given with --no-silhouettes; leave one of them out")
    if not 1 <= request.count <= 100:
        raise InputError(f"--count: is {request.count}; expected 1 to 100 frames")
    if request.height is not None:
        Person(height=request.height)  # refuses what no person is


def _read(request: FitRequest) -> Inputs:
    read = partial(
        read_inputs,
        request.videos,
        request.cameras,
        request.detections,
        frames=request.frames,
        video_map=request.video_map,
        detections_in_video=request.detections_in == "video",
    )
    lifter = None if request.lifter is None else OnnxLifter(find_model(request.lifter, LIFTERS))
    if request.detector is None:
        return lift_inputs(read(), lifter)
    detector = OnnxDetector(find_model(request.detector, DETECTORS))
    boxes = parse_boxes(request.box, len(request.videos))
    with progress_bars() as tell:
        return lift_inputs(read(detecting=Detecting(detector, boxes, tell)), lifter)


def _source(chosen: ChosenFrames, silhouettes: bool) -> str:
    shown = "joints and silhouettes" if silhouettes else "joints"
    frames, views = len(chosen), chosen.clip.views
    return f"body fitted to {shown} of {frames} frames in {views} view{'s' if views > 1 else ''}"


def _doubts(request: FitRequest, fit: BodyFit, views: int) -> Iterator[str]:
    if views == 1 and request.height is None:
        yield (
            "one camera does not tell a person's size from the distance; the height is mostly a "
            "guess, give --height"
        )
    elif fit.deviations.height > _DOUBTFUL:
        yield f"the height is known to {100 * fit.deviations.height:.0f} cm only; give --height"
