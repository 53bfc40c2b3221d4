"""``perfcap actor fit``: an actor with the body of a person who is seen by calibrated cameras."""

from __future__ import annotations

import logging
from dataclasses import replace

import torch

from perfcap.actor.actor import Actor
from perfcap.app.actor_build import spare_sources
from perfcap.app.actor_inspect import run_inspect
from perfcap.app.capture_checks import examined, told
from perfcap.app.console import PlainConsole
from perfcap.app.inputs import read_inputs
from perfcap.app.masked_frames import order_doubts
from perfcap.app.measures import print_measures
from perfcap.app.personal_body import BodyRequest, find_body
from perfcap.app.project import in_project
from perfcap.commands.actor import ActorFit
from perfcap.errors import InputError
from perfcap.io.actor_folder import save_actor, spare_actor
from perfcap.io.actor_place import FIT_SHEET, MANIFEST, spare_files
from perfcap.io.mask_files import MaskFolders
from perfcap.rigging import Person

_LOG = logging.getLogger(__name__)


def run_fit(request: ActorFit) -> int:
    """Fit, write the actor's folder and show what is in it; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    torch.set_num_threads(1)  # stages that look at images run a thread a core
    _check(request)
    request = in_project(request)
    inputs = examined(
        read_inputs(request),
        needs_images=request.evidence != "joints" and not request.masks,
        detected=bool(request.detectors),
    )
    if request.masks:
        masks = MaskFolders.open(request.masks, inputs.clip)
        inputs = told(inputs, [*order_doubts(inputs, masks)])
    body = find_body(
        inputs,
        BodyRequest(
            count=request.count,
            height=request.height,
            masks=request.masks,
            evidence=request.evidence,
            model=request.body_model,
        ),
    )
    template = replace(body.template, name=request.name or request.out.name).rounded()
    licence = body.model.rig.licence
    spare_actor(request.out, template.name)
    save_actor(
        Actor(template),
        request.out,
        licence=licence,
        provenance=body.source,
        beside=lambda folder: body.save(folder, FIT_SHEET),
    )
    code = run_inspect(str(request.out), None, request.out)
    print_measures(body.fit.measurements, body.fit.deviations)
    for line in body.doubts():
        _LOG.warning("%s", line)
    console = PlainConsole()
    console.print(f"look at {request.out / FIT_SHEET}", soft_wrap=True)
    console.print(f"capture with --actor {request.out}", soft_wrap=True)
    return code


def _check(request: ActorFit) -> None:
    if request.out.exists() and not request.out.is_dir():
        raise InputError(f"--out {request.out}: is a file; expected a folder for {MANIFEST}")
    spare_sources(request.out, request.body_model)
    spare_files(request.out)
    if request.masks and request.evidence != "silhouettes":
        raise InputError(
            f"--masks: are given with --from {request.evidence}; leave one of them out"
        )
    if not 1 <= request.count <= 100:
        raise InputError(f"--count: is {request.count}; expected 1 to 100 frames")
    if request.height is not None:
        Person(height=request.height)  # refuses what no person is
