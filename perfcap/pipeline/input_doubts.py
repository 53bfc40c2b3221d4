"""What ``perfcap doctor`` would say of inputs that are given in Python, and of an actor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from perfcap.actor.actor import Actor
from perfcap.actor.bone_correction import SHORTEST, TALLEST
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import (
    Severity,
    examine_agreement,
    examine_cameras,
    examine_detections,
)
from perfcap.io.doctor.evidence import Scene

_HEIGHT = (0.5, 2.6)  # m, of people
_RATIO = (0.87, 1.15)  # of the actor's legs to those that the views show
_NONE = 0.01  # m: these are no legs
_TRIMS = 6  # rounds in which triangulation lets outliers go
_LEGS = [[LANDMARKS.index(f"{s}_{n}") for n in ("hip", "knee", "ankle")] for s in "lr"]


def input_doubts(cameras: Camera, detections: Detections) -> tuple[str, ...]:
    """A sentence for each mistake in units, axes, lenses, views and frames that numbers show.

    Args:
        cameras: C views, (C,) or (F, C); the middle of an image without a size is taken to be
            where its lens looks.
        detections: (F, C).
    """
    known = cameras.map(lambda part: part.detach().double().cpu())
    seen = detections.to(known.intrinsics).map(lambda part: part.detach())
    middles = known.intrinsics[..., :2, 2].reshape(-1, known.views, 2)[0]
    sizes = tuple((round(2 * y) + 1, round(2 * x) + 1) for x, y in middles.tolist())
    names = tuple(f"view {view}" for view in range(known.views))
    rig = CameraRig(names, replace(known, size=known.size or sizes))
    findings = (
        *examine_cameras(rig),
        *examine_detections(rig, seen, coverage=False),
        *examine_agreement(rig, seen),
    )
    return tuple(
        "; ".join(part for part in (f"{found.subject}: {found.what}", found.remedy) if part)
        for found in findings
        if found.severity is not Severity.INFO
    )


def actor_doubts(
    actor: Actor, cameras: Camera, detections: Detections, solve_bones: bool
) -> Iterator[str]:
    """Whether the actor has the size of a person, and of this one where views show it.

    Args:
        actor: who is to be captured.
        cameras: C views, (C,) or (F, C).
        detections: (F, C).
        solve_bones: whether bone lengths are solved, so that the actor's own do not matter.
    """
    rest = actor.skeleton.rest_landmarks.detach().double().cpu()
    height = float(rest[:, 1].max() - rest[:, 1].min())
    if not _HEIGHT[0] < height < _HEIGHT[1]:
        yield (
            f"the actor is {height:.3g} m tall, expected {_HEIGHT[0]} to {_HEIGHT[1]}; scale it to "
            "metres, or places and sizes are wrong by that factor"
        )
        return
    if detections.views < 2 and not SHORTEST <= height <= TALLEST:
        yield (
            f"the actor is {height:.3g} m tall, a grown person {SHORTEST} to {TALLEST}; from one "
            "view distances and sizes follow it, scale it unless the person is so tall"
        )
    if detections.views < 2 or solve_bones:
        return
    known = cameras.map(lambda part: part.detach().double().cpu())
    found = detections.to(known.intrinsics).map(lambda part: part.detach())
    points, _ = Scene(known, found).straightened().sampled().triangulated(_TRIMS)
    seen = points[:, _LEGS].diff(dim=2).norm(dim=-1).sum(-1)
    own = float(rest[None][:, _LEGS].diff(dim=2).norm(dim=-1).sum(-1).mean())
    shown = float(seen.nanmedian()) if seen.numel() else math.nan
    if not (math.isfinite(shown) and shown > _NONE):
        return
    ratio = own / shown
    if not _RATIO[0] < ratio < _RATIO[1]:
        yield (
            f"the actor's legs are {ratio:.2g} times as long as those that the views show; check "
            "the scale and the focal lengths of the calibration, solve the bone lengths (--bones "
            "solve, solve_bones=True), or give the actor of this person"
        )
