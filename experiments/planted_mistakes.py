"""Mistakes planted in joints that are given: how many are named, and what is named of right ones.

In any: joints cut down to a grid of 3 % of the person's height, joints that follow each other in a
limb exchanged throughout, one joint of both sides for a third of the clip, frames in no order, a
third of the clip backwards. In two calibrated views or more: one joint of both sides exchanged
throughout, two views exchanged from the middle of the clip on, arms or legs exchanged in all views
for a third of it, joints exchanged in one view throughout, five frames put in. In one view with 3D
poses: joints of both sides exchanged throughout; 3D poses mirrored, sides and all, and 2D joints
not; left and right exchanged, or depth negated, for a third of the clip. What is said of the right
input as well does not count.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import report
import torch
from recordings import Recording, balancing, demo, rendered, rendered_views
from report import Report, Table
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Severity, examine_agreement, examine_detections

_PAIRS = ("elbow", "wrist", "knee", "ankle", "toe")
_NEIGHBOURS = (("elbow", "wrist"), ("knee", "ankle"), ("shoulder", "elbow"), ("hip", "knee"))
_ARMS, _LEGS = ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle", "toe")
_SEVERAL = (("dev_views", 1), ("dev_dance", 1), ("dev_duo", 2), ("dev_trio", 3), ("dev_twins", 2))
_PUT_IN = 5  # frames
_CELL = 0.03  # of the person's height


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sets: int = 6
    """Of two to four views of each recording, drawn at random."""
    seed: int = 0
    """Of the sets."""


def run(config: Experiment) -> Report:
    """A row for each mistake."""
    torch.set_num_threads(1)
    counts: dict[str, list[bool]] = {}
    alarms: list[tuple[str, str, str]] = []
    for name, rig, seen in _inputs(config):
        right = _said(rig, seen)
        alarms += [(name, " ".join(rig.names), said) for said in sorted(right)]
        whose = "one view" if seen.views == 1 else "several views"
        counts.setdefault(f"{whose}: none", []).append(bool(right))
        for mistake, joints in _spoiled(seen):
            named = bool(_said(rig, joints) - right)
            counts.setdefault(f"{whose}: {mistake}", []).append(named)
    rows = tuple(
        (mistake, len(named), sum(named), 100 * sum(named) / len(named))
        for mistake, named in counts.items()
    )
    columns = ("mistake", "inputs", "something is said of", "%")
    said = Table("said of right inputs", ("recording", "views", "what"), tuple(alarms))
    return Report((Table("planted mistakes", columns, rows, 0), said))


def _inputs(config: Experiment) -> Iterator[tuple[str, CameraRig, Detections]]:
    rng = np.random.default_rng(config.seed)
    for clip in _several(config.data):
        every = [s for n in (2, 3, 4) for s in combinations(range(clip.cameras.views), n)]
        for index in rng.permutation(len(every))[: config.sets].tolist():
            views = list(every[index])
            seen = clip.detections.select(views).without_poses()
            yield clip.name, clip.rig.select(views), seen
    alone = [rendered(config.data, name) for name in ("dev_tight", "dev_skirt", "dev_coat")]
    for clip in (*alone, demo()):
        yield clip.name, clip.rig, clip.detections


def _several(data: Path) -> Iterator[Recording]:
    for name, people in _SEVERAL:
        yield from (rendered_views(data, name, person) for person in range(1, people + 1))
    yield balancing(data)


def _said(rig: CameraRig, seen: Detections) -> set[str]:
    found = (*examine_detections(rig, seen, coverage=False), *examine_agreement(rig, seen))
    return {str(each) for each in found if each.severity is not Severity.INFO}


def _spoiled(seen: Detections) -> Iterator[tuple[str, Detections]]:
    alone, count = seen.views == 1, seen.frame_count
    whole, third = slice(None), slice(count // 3, 2 * count // 3)
    shown = torch.where(seen.confidence2d > 0, seen.joints2d[..., 1], torch.nan)
    least, most = shown.nan_to_num(torch.inf).amin(-1), shown.nan_to_num(-torch.inf).amax(-1)
    cell = _CELL * (most - least).clamp(min=1).median(0).values[:, None, None]  # C 1 1
    yield (
        "joints at corners of cells",
        replace(seen, joints2d=(seen.joints2d / cell).floor() * cell),
    )
    for name in _PAIRS:
        yield f"{name}s exchanged", _ordered(seen, _exchange(name), whole)
    for limb in (_ARMS, _LEGS):
        mistake = f"{'s, '.join(limb[1:])}s exchanged"
        yield mistake, _ordered(seen, _exchange(*limb[1:]), whole)
    for upper, lower in _NEIGHBOURS:
        mistake = f"{upper}s and {lower}s exchanged"
        yield mistake, _ordered(seen, _exchange_neighbours(upper, lower), whole)
    for name in _PAIRS:
        yield f"{name}s exchanged, a third", _ordered(seen, _exchange(name), third)
    mixed = np.random.default_rng(0).permutation(count)
    yield "frames in no order", seen.frames(torch.from_numpy(mixed))
    turned = torch.arange(count)
    turned[third] = turned[third].flip(0)
    yield "a third backwards", seen.frames(turned)
    if alone:
        order = list(LANDMARKS16.mirrored())
        yield "left and right, a third", _ordered(seen, order, third)
        yield "depth negated, a third", _ordered(seen, range(16), third, depth=-1.0)
        assert seen.joints3d is not None
        mirrored = seen.joints3d[..., order, :] * seen.joints3d.new_tensor([-1.0, 1.0, 1.0])
        yield "3D poses mirrored", replace(seen, joints3d=mirrored)
        return
    for names, limbs in ((_ARMS, "arms"), (_LEGS, "legs")):
        yield f"{limbs} exchanged, a third", _ordered(seen, _exchange(*names), third)
    for joints, order in (
        ("elbows and wrists", _exchange_neighbours("elbow", "wrist")),
        ("knees and ankles", _exchange_neighbours("knee", "ankle")),
        ("wrists", _exchange("wrist")),
        ("arms", _exchange(*_ARMS)),
        ("legs", _exchange(*_LEGS)),
    ):
        yield f"{joints} of one view exchanged", _in_one_view(seen, order)
    if seen.views > 2:
        views = torch.arange(seen.views)
        views[:2] = torch.tensor([1, 0])
        late = torch.arange(count) >= count // 2
        yield (
            "two views exchanged from the middle",
            seen.select(views.tolist()).where(late, seen),
        )
    later = torch.arange(count)
    later[count // 3 :] = (later[count // 3 :] - _PUT_IN).clamp(min=0)
    yield f"{_PUT_IN} frames put in", seen.frames(later)


def _in_one_view(seen: Detections, order: Sequence[int]) -> Detections:
    """Joints of the first view in another order."""
    joints, confidence = seen.joints2d.clone(), seen.confidence2d.clone()
    joints[:, 0], confidence[:, 0] = joints[:, 0][:, order], confidence[:, 0][:, order]
    return replace(seen, joints2d=joints, confidence2d=confidence)


def _exchange(*names: str) -> list[int]:
    """Order of the landmarks with these joints of both sides exchanged."""
    order = list(range(len(LANDMARKS)))
    for name in names:
        left, right = (LANDMARKS.index(f"{side}_{name}") for side in "lr")
        order[left], order[right] = right, left
    return order


def _exchange_neighbours(upper: str, lower: str) -> list[int]:
    """Order of the landmarks with two joints of each limb in each other's place."""
    order = list(range(len(LANDMARKS)))
    for side in "lr":
        one, other = (LANDMARKS.index(f"{side}_{name}") for name in (upper, lower))
        order[one], order[other] = other, one
    return order


def _ordered(seen: Detections, order: Sequence[int], part: slice, depth: float = 1.0) -> Detections:
    """Joints in another order in a part of the frames, and depth times a factor."""

    def changed(values: Tensor, axis: int) -> Tensor:
        result = values.clone()
        result[part] = values[part].index_select(axis, torch.tensor([*order]))
        return result

    poses = seen.joints3d
    if poses is not None:
        poses = changed(poses, -2)
        poses[part, ..., 2] *= depth
    return replace(
        seen,
        joints2d=changed(seen.joints2d, -2),
        confidence2d=changed(seen.confidence2d, -1),
        joints3d=poses,
    )


if __name__ == "__main__":
    report.main(run, Experiment, "planted_mistakes")
