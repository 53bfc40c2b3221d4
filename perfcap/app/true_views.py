"""``--sync`` and ``--refine-cameras``: views corrected before anything else is done with them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch

from perfcap.app.inputs import Inputs
from perfcap.errors import InputError
from perfcap.io.body_model import DEFAULT_BODY, load_body_model
from perfcap.io.clip import Clip, LateSource
from perfcap.pipeline.view_errors import ViewErrors, solve_views


def settled(inputs: Inputs, sync: bool, refine: bool) -> tuple[Inputs, dict[str, Any]]:
    """The inputs with clocks and cameras as a moving person shows them, and what was found.

    Videos are read from the nearest whole frame, joints between frames.

    Args:
        inputs: of two views or more.
        sync: whether clocks are found.
        refine: whether cameras may stand a little elsewhere.

    Raises:
        InputError: one view, cameras that move, or a clip too short to tell.
    """
    if not (sync or refine):
        return inputs, {}
    option = "--sync auto" if sync else "--refine-cameras"
    actor = load_body_model(DEFAULT_BODY).actor(torch.zeros(0))
    like = torch.zeros((), dtype=torch.float64)
    cameras, detections = inputs.rig.cameras.to(like), inputs.detections.to(like)
    rate = inputs.clip.fps
    try:
        found = solve_views(actor, cameras, detections, rate, sync=sync, refine=refine)
    except InputError as error:
        raise InputError(f"{option}: {error}") from error
    names, start = list(inputs.rig.names), inputs.clip.start
    counts = [len(source) for source in inputs.clip.sources]
    changed = replace(
        inputs,
        clip=_late(inputs.clip, found),
        rig=replace(inputs.rig, cameras=found.of_cameras(inputs.rig.cameras)),
        detections=found.of_detections(inputs.detections),
        lag=found.lag(range(start, start + len(inputs.clip)), counts),
        warnings=(*inputs.warnings, *found.sentences(names)),
    )
    return changed, found.report(names)


def _late(clip: Clip, found: ViewErrors) -> Clip:
    """The clip with each view from the frame nearest to its clock."""
    if found.late is None:
        return clip
    whole = [round(value) for value in found.late.tolist()]
    sources = [
        LateSource(source, late) if late else source
        for source, late in zip(clip.sources, whole, strict=True)
    ]
    return Clip(sources, clip.fps, clip.warnings, clip.start, clip.start + len(clip))
