"""Legs of an actor against those that several views show."""

from __future__ import annotations

import math

from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.doctor.evidence import Scene

NO_LEGS = 0.01  # m: these are none
LEGS = [[LANDMARKS.index(f"{s}_{n}") for n in ("hip", "knee", "ankle")] for s in "lr"]
_TRIMS = 6  # rounds in which triangulation lets outliers go


def leg_ratio(actor: Actor, cameras: Camera, detections: Detections) -> float | None:
    """Length of an actor's legs over that of the legs which several views show; None if unknown.

    Args:
        actor: in its rest pose.
        cameras: C views, (C,) or (F, C).
        detections: (F, C).
    """
    if detections.views < 2:
        return None
    return ratio_to(actor, triangulated(cameras, detections))


def ratio_to(actor: Actor, points: Tensor) -> float | None:
    """The same of placed landmarks (N, 16, 3), NaN where unknown."""
    seen = leg_lengths(points)
    own = float(leg_lengths(rest_landmarks(actor)[None]).mean())
    shown = float(seen.nanmedian()) if seen.numel() else math.nan
    return own / shown if math.isfinite(shown) and shown > NO_LEGS else None


def leg_lengths(points: Tensor) -> Tensor:
    """Lengths of both legs (N, 2), hip to ankle, of placed landmarks (N, 16, 3)."""
    lengths: Tensor = points[:, LEGS].diff(dim=2).norm(dim=-1).sum(-1)
    return lengths


def rest_landmarks(actor: Actor) -> Tensor:
    """Landmarks of an actor at rest, (16, 3) m, in double precision."""
    return actor.skeleton.rest_landmarks.detach().double().cpu()


def triangulated(cameras: Camera, detections: Detections) -> Tensor:
    """Joints of some frames where two views see them, (N, 16, 3) m, else NaN."""
    known = cameras.map(lambda part: part.detach().double().cpu())
    found = detections.to(known.intrinsics).map(lambda part: part.detach())
    points, _ = Scene(known, found).straightened().sampled().triangulated(_TRIMS)
    return points
