"""``perfcap actor fit``: an actor with the body of a person who is seen by calibrated cameras."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from perfcap.actor.actor import Actor
from perfcap.app.actor_inspect import run_inspect
from perfcap.app.console import PlainConsole
from perfcap.app.fit_sheet import FIT_SHEET, save_fit_sheet
from perfcap.app.fit_views import ChosenFrames, choose_frames, fit_person, read_masks
from perfcap.app.inputs import InputRequest, read_inputs
from perfcap.app.measures import print_measures, save_measures
from perfcap.errors import InputError
from perfcap.io.actor_folder import MANIFEST, save_actor
from perfcap.io.body_model import DEFAULT_BODY, load_body_model
from perfcap.rigging import BodyFit, Person

_LEAST = 3  # joints a frame: fewer fix no pose
_DOUBTFUL = 0.03  # metres of deviation of the height above which it is told

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class FitRequest(InputRequest):
    """What the command line asks for; see ``perfcap actor fit --help``."""

    out: Path
    masks: tuple[Path, ...] = ()
    silhouettes: bool = True
    height: float | None = None
    count: int = 12
    name: str | None = None
    body_model: str = DEFAULT_BODY


def run_fit(request: FitRequest) -> int:
    """Fit, write the actor's folder and show what is in it; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    torch.set_num_threads(1)  # stages that look at images run a thread a core
    _check(request)
    model = load_body_model(request.body_model)
    inputs = read_inputs(request)
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
    console = PlainConsole()
    console.print(f"look at {request.out / FIT_SHEET}", soft_wrap=True)
    console.print(f"capture with --actor {request.out}", soft_wrap=True)
    return code


def _check(request: FitRequest) -> None:
    if request.out.exists() and not request.out.is_dir():
        raise InputError(f"--out {request.out}: is a file; expected a folder for {MANIFEST}")
    if request.masks and not request.silhouettes:
        raise InputError("--masks: are given with --no-silhouettes; leave one of them out")
    if not 1 <= request.count <= 100:
        raise InputError(f"--count: is {request.count}; expected 1 to 100 frames")
    if request.height is not None:
        Person(height=request.height)  # refuses what no person is


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
