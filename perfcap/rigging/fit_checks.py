"""Whether what a body is fitted to is sound, else refused or told, and what came of it."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_checks import require_joints
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.camera_checks import require_usable
from perfcap.io.doctor import Severity
from perfcap.io.doctor.given import examine_given
from perfcap.io.doctor.held_masks import held_within
from perfcap.io.doctor.mask_joints import limb_doubts, others_doubts
from perfcap.io.doctor.same_poses import pose_doubts
from perfcap.rigging.build_body import Person
from perfcap.rigging.drawn_bodies import Areas, areas_of, faint_doubts, wide_doubts
from perfcap.rigging.fit_doubts import FittedTo, depth_doubts, fit_doubts
from perfcap.rigging.person_masks import PersonMasks
from perfcap.rigging.view_fit import ViewFitSettings
from perfcap.setting_checks import require_number

if TYPE_CHECKING:
    from perfcap.rigging.fit_body import BodyFit

_ALL_MASKS = "silhouettes "  # how sentences about masks of all views begin


def require_fit(
    model: BodyModel, cameras: Camera, detections: Detections, initial: Motion, height: float | None
) -> None:
    """Refuse arguments of ``fit_body`` of another kind, size or unit; joints are finite.

    Raises:
        InputError: one is.
    """
    given = (model, BodyModel), (cameras, Camera), (detections, Detections), (initial, Motion)
    for value, kind in given:
        if not isinstance(value, kind):
            raise InputError(f"body fit: got a {type(value).__name__}, expected a {kind.__name__}")
    if height is not None:
        require_number(height, "height")
        Person(height=height)  # refuses what no person is
    shape, frames = tuple(detections.joints2d.shape), detections.frame_count
    if len(shape) != 4 or shape[1] != cameras.views:
        raise InputError(
            f"detections have joints2d {shape} for cameras of {cameras.views} views; expected "
            "(F, C, 16, 2) of as many views"
        )
    if initial.frames != frames:
        raise InputError(
            f"initial has {initial.frames} frames but detections have {frames}; give a pose for "
            "each"
        )
    if cameras.moving and len(cameras.intrinsics) != frames:
        raise InputError(
            f"moving cameras have {len(cameras.intrinsics)} frames but detections have {frames}; "
            "give as many poses as frames"
        )
    require_usable("cameras", cameras, frames)
    like = model.surface.mean.dtype
    kinds = {x.dtype for x in (cameras.intrinsics, detections.joints2d, initial.angles)}
    if kinds != {like}:
        found = ", ".join(sorted(map(str, kinds)))
        raise InputError(
            f"cameras, detections and initial are {found}, the body {like}; take them there with "
            f"x.to(torch.zeros(1, dtype={like}))"
        )
    sure = detections.confidence2d
    if not bool((sure > 0).any()):
        raise InputError("detections show nobody in any frame; expected one person's joints")
    require_joints(detections)


def warn_of_inputs(cameras: Camera, detections: Detections, masks: PersonMasks | None) -> None:
    """Warn of what a capture would warn of, and of masks of somebody else, (F, C)."""
    names = _views(cameras)
    seen = detections.map(_plain)
    # frames to fit to are picked from a clip
    found = examine_given(cameras, seen, successive=False)
    told = [
        f"{each.subject}: {each.what}; {each.remedy}"
        for each in found
        if each.severity is not Severity.INFO
    ]
    if masks is not None:
        there, own = _seen_in(masks, cameras, detections)
        parts = names, there, own.inside, own.known
        told += [*others_doubts(*parts), *limb_doubts(*parts)]
        told += pose_doubts(names, cameras, masks.cameras, "masks")
        told += _known_doubts(own)
    for line in told:
        warnings.warn(f"body fit: {line}", stacklevel=3)


def _known_doubts(masks: PersonMasks) -> Iterator[str]:
    """A sentence about masks of which hardly more than the inside is known."""
    held = None if masks.known is None else held_within(masks.inside, masks.known)
    if held is not None:
        yield (
            f"masks are known outside of the person by {held:.0%} of how much inside: the body may "
            "grow beyond them at no cost; expected in known which pixels say anything, not where "
            "the person is"
        )


def _seen_in(
    masks: PersonMasks, cameras: Camera, detections: Detections
) -> tuple[Detections, PersonMasks]:
    """Detections (F, C) in pixels of the masks, and these."""
    ideal = torch.nn.functional.pad(cameras.to_plane(detections.joints2d), (0, 1), value=1.0)
    pixels = masks.cameras.to(ideal).project_camera(ideal)
    there = replace(detections, joints2d=pixels).map(_plain)
    known = None if masks.known is None else _plain(masks.known)
    return there, PersonMasks(masks.cameras, _plain(masks.inside), known)


def warn_of_result(
    model: BodyModel,
    fit: BodyFit,
    cameras: Camera,
    detections: Detections,
    height: float | None,
    masks: PersonMasks | None,
    of_joints: Motion | None = None,
) -> None:
    """Warn of what speaks against a fitted body; ``warn_of_inputs`` knows masks of others.

    Args:
        model: of the body.
        fit: the body.
        cameras: C views, (C,) or (F, C).
        detections: (F, C), that it was fitted to.
        height: as it was given, metres.
        masks: that it was fitted to.
        of_joints: (F,), with the shape, fitted before masks were looked at.
    """
    masked = None if masks is None else _seen_in(masks, cameras, detections)
    seen, names = (cameras.map(_plain), detections.map(_plain)), _views(cameras)
    given = FittedTo(*seen, height, masked, names, range(fit.motion.frames))
    plain = replace(fit, motion=fit.motion.map(_plain))
    body = model if model.surface.mean.device.type == "cpu" else deepcopy(model).cpu()
    told = list(fit_doubts(body, plain, given))
    if masked is not None:
        there, own = masked
        known = {*others_doubts(names, there, own.inside, own.known)}
        told = [line for line in told if line not in known]
        if of_joints is not None:
            told = _with_areas(told, areas_of(body, of_joints.map(_plain), own), names)
    for line in (*depth_doubts(plain, given), *told):
        warnings.warn(f"body fit: {line}", stacklevel=3)


def _with_areas(told: list[str], areas: Areas, names: list[str]) -> list[str]:
    """What was said of masks, and of areas what does not say the same of a view again."""
    faint = list(faint_doubts(areas, names))
    if faint:  # a body within them leaves as much out as one in a coat, and is no such
        return [*faint, *(line for line in told if not line.startswith(_ALL_MASKS))]
    if any(line.startswith(_ALL_MASKS) for line in told):
        return told
    said = tuple(f"masks of {name}: " for name in names)
    named = {line[: line.index(": ") + 2] for line in told if line.startswith(said)}
    wide = wide_doubts(areas, names)
    return [*told, *(line for line in wide if line[: line.index(": ") + 2] not in named)]


def _plain(part: Tensor) -> Tensor:
    return part.detach().cpu()


def _views(cameras: Camera) -> list[str]:
    return [f"view {view}" for view in range(cameras.views)]


def require_masks(masks: object, frames: int, settings: ViewFitSettings) -> None:
    """Refuse masks that are none, of other frames or sizes, or that settings would not look at.

    Raises:
        InputError: they are.
    """
    if not isinstance(masks, PersonMasks):
        raise InputError(
            f"masks are a {type(masks).__name__}, expected PersonMasks(cameras, inside)"
        )
    if len(masks.inside) != frames:
        raise InputError(
            f"masks have {len(masks.inside)} frames but detections have {frames}; give a mask for "
            "each"
        )
    size = tuple(masks.inside.shape[-2:])
    if any(tuple(own) != size for own in masks.cameras.size):
        raise InputError(
            f"masks are {size} (height, width), their cameras of images of "
            f"{masks.cameras.size[0]}; give cameras in pixels of the masks"
        )
    if not settings.heights or len(settings.steps) != len(settings.heights) + 1:
        raise InputError(
            f"body fit: heights are {len(settings.heights)} and steps {len(settings.steps)}; with "
            "masks expected one step more than heights, of which there is one at least"
        )
