"""Views corrected before anything else is done with them: clocks, places, a guessed lens."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch

from perfcap.app.gravity import find_up
from perfcap.app.inputs import Inputs
from perfcap.app.moving_camera import camera_moves, find_motion
from perfcap.errors import InputError
from perfcap.io.body_model import DEFAULT_BODY, load_body_model
from perfcap.io.clip import Clip, late_views
from perfcap.pipeline.camera_motion import CameraMotion
from perfcap.pipeline.lens import solve_lens
from perfcap.pipeline.view_errors import ViewErrors, solve_views


def settled(
    inputs: Inputs, sync: bool, refine: bool, *, assumed: bool = False, held: bool = True
) -> tuple[Inputs, dict[str, Any]]:
    """The inputs with clocks and cameras as a moving person shows them, and what was found.

    Videos are read from the nearest whole frame, joints between frames. A lens that is a guess
    becomes the one that what is behind the person shows, or their motion, if one of them does.

    Args:
        inputs: of two views or more, where clocks or places are to be found.
        sync: whether clocks are found (``--sync``).
        refine: whether cameras may stand a little elsewhere (``--refine-cameras``).
        assumed: whether there is one view, whose camera is not calibrated: up is looked for then.
        held: whether that camera may have been moved.

    Raises:
        InputError: one view, cameras that move, or a clip too short to tell.
    """
    if not (sync or refine):
        return _alone(inputs, held) if assumed else (inputs, {})
    option = "--sync auto" if sync else "--refine-cameras"
    actor = load_body_model(DEFAULT_BODY).actor(torch.zeros(0))
    like = torch.zeros((), dtype=torch.float64)
    cameras, detections = inputs.rig.cameras.to(like), inputs.detections.to(like)
    rate = inputs.clip.fps
    try:
        given = actor, cameras, detections, rate
        found = solve_views(*given, sync=sync, refine=refine, examined=True)
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


def _alone(inputs: Inputs, held: bool) -> tuple[Inputs, dict[str, Any]]:
    """The inputs of one view with all that pixels and poses tell of its camera."""
    moves = held and camera_moves(inputs)
    inputs = replace(inputs, rests=held and not moves)
    motion, lines = find_motion(inputs) if moves else (None, ())
    inputs = replace(inputs, warnings=(*inputs.warnings, *lines))
    found: dict[str, Any] = {}
    if motion is not None:
        inputs, found = _with_motion(inputs, motion)
    elif inputs.rig.guessed:
        inputs, found = _with_lens(inputs)
    up = find_up(inputs) if motion is None else motion.up
    if up is None:
        return inputs, found
    return replace(inputs, up=up), {**found, "up": up.tolist()}


def _with_motion(inputs: Inputs, motion: CameraMotion) -> tuple[Inputs, dict[str, Any]]:
    """The inputs with a camera that moves."""
    rig = inputs.rig
    changed = replace(inputs, rig=replace(rig, cameras=motion.of_camera(rig.cameras)))
    return changed, {"camera_motion": motion.report()}


def _with_lens(inputs: Inputs) -> tuple[Inputs, dict[str, Any]]:
    """The inputs with the lens that the motion shows."""
    actor = load_body_model(DEFAULT_BODY).actor(torch.zeros(0))
    like = torch.zeros((), dtype=torch.float64)
    rig, detections = inputs.rig, inputs.detections.to(like)
    lens = solve_lens(actor, rig.cameras.to(like), detections, inputs.clip.fps)
    changed = replace(
        inputs,
        rig=replace(rig, cameras=lens.of_camera(rig.cameras)),
        warnings=(*inputs.warnings, lens.sentence(rig.cameras)),
    )
    return changed, {"lens": lens.report()}


def _late(clip: Clip, found: ViewErrors) -> Clip:
    """The clip with each view from the frame nearest to its clock."""
    if found.late is None:
        return clip
    whole = [round(value) for value in found.late.tolist()]
    return late_views(clip, whole, clip.start + len(clip))
