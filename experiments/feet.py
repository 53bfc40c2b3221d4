"""Feet that stand: slide, feet under the floor, the floor found, and what contact costs in joints.

Given detections, motion only, contact off and on. The recordings were looked at while the method
was made, its constants were chosen on clips of the CMU library that are none of them. Slide is
that of ankles and toes over steps in which the true ones stand; under the floor are frames in
which a point under a foot is more than 1 cm below the true floor, or below the floor found; the
floor found is compared at the middle of the feet, once with the world's axes as candidates and
once without.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import report
import torch
from recordings import Recording, balancing, demo, rendered, rendered_views
from report import Report, Table
from torch import Tensor

from perfcap.actor.sole_points import sole_skeleton
from perfcap.detect.joint_set import LANDMARKS
from perfcap.metrics import floor_contact, foot_skate, joint_errors
from perfcap.pipeline.floor import find_floor
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.stage import Stage

FEET = [LANDMARKS.index(f"{side}_{joint}") for side in "rl" for joint in ("ankle", "toe")]
_DEEP = 0.01  # m
_COLUMNS = (
    "clip", "contact", "PA-MPJPE", "absolute", "slide", "true slide", "under true floor %",
    "under own floor %",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""


def run(config: Experiment) -> Report:
    """Every clip with contact off and on."""
    torch.set_num_threads(1)
    rows, floors = [], []
    for clip, up in _clips(config.data):
        for word, enabled in (("off", False), ("on", True)):
            found = _capture(clip, enabled)
            rows.append((clip.name, word, *_scores(clip, found, up)))
        floors.append((clip.name, *_floor(clip, found, up)))
    columns = ("clip", "normal, degrees", "without world's axes", "height, mm", "support")
    return Report(
        (
            Table("feet, mm and mm/frame", _COLUMNS, tuple(rows), 1),
            Table("floor of the captures with contact", columns, tuple(floors), 2),
        ),
        tuple((__doc__ or "").strip().splitlines()[2:]),
    )


def _clips(data: Path) -> Iterator[tuple[Recording, Tensor]]:
    """Recordings whose world has y up and, but for the real man's, the floor at y = 0."""
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    for name in ("dev_tight", "dev_skirt", "dev_coat"):
        yield rendered(data, name), up
    people = (("dev_dance", 1), ("dev_views", 1), ("dev_duo", 1), ("dev_duo", 2), ("dev_trio", 1))
    for name, person in people:
        clip = rendered_views(data, name, person)
        yield replace(clip, name=f"{name} {person}"), up
    yield demo(), up
    man = balancing(data)
    yield man, up.roll(1)  # its world has z up


def _capture(clip: Recording, contact: bool) -> Performance:
    settings = CaptureConfig()
    pose = replace(settings.pose, contact=replace(settings.pose.contact, enabled=contact))
    return capture(
        clip.actor,
        clip.cameras,
        clip.detections,
        clip.rate,
        replace(settings, pose=pose),
        until=Stage.TRACK_MOTION,
        solve_bones=clip.name == "balancing",
        workers=1,
    )


def _scores(clip: Recording, found: Performance, up: Tensor) -> tuple[float, ...]:
    joints, truth = found.joints(), clip.truth
    errors = joint_errors(joints, truth, clip.rate, partial=True)
    standing = truth[:, FEET]
    known = standing.isfinite().all(-1).any(0)
    contact = floor_contact(standing[:, known], standing[:, known] @ up, clip.rate)
    feet = joints[:, FEET][:, known]
    soles = sole_skeleton(found.actor)(found.motion).landmarks[:, -8:]
    own = found.floor.above(soles) if found.floor is not None else soles @ up * torch.nan
    true = soles @ up if clip.name != "balancing" else torch.full_like(own, torch.nan)
    return (
        float(errors.mpjpe_similarity),
        float(errors.mpjpe),
        float(foot_skate(feet, contact, up)),
        float(foot_skate(standing[:, known], contact, up)),
        *(_share_below(height) for height in (true, own)),
    )


def _share_below(height: Tensor) -> float:
    if not bool(height.isfinite().all()):
        return math.nan
    return 100 * float((height.amin(-1) < -_DEEP).double().mean())


def _floor(clip: Recording, found: Performance, up: Tensor) -> tuple[float | str, ...]:
    if found.floor is None:
        return ("none", "none", "none", "none")
    soles = sole_skeleton(found.actor)(found.motion).landmarks[:, -8:]
    free = find_floor(found.joints(), soles, clip.rate)
    middle = soles.mean((0, 1))
    below = middle - (middle @ up) * up
    height = (found.floor.height - found.floor.normal @ below) / (found.floor.normal @ up)
    angles = [math.degrees(math.acos(min(1.0, float(f.normal @ up)))) for f in (found.floor, free)]
    known = clip.name != "balancing"
    return (*angles, 1000 * float(height) if known else math.nan, found.floor.support)


if __name__ == "__main__":
    report.main(run, Experiment, "feet")
