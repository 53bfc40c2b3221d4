"""Which view shows its frames earlier or later than the others, and by how many."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from perfcap.io.doctor.detections import CONFIDENT
from perfcap.io.doctor.evidence import Scene
from perfcap.io.doctor.hypotheses import Hypothesis, delayed

SHIFTS = 30  # frames looked at, both ways
NEARER = 0.7  # a view is late if undoing that leaves at most this share of its error
_LIKE = 2.0  # times the error of other views: more has another cause
_NOTHING = 1e-6  # px
_FRAMES = 200  # of a clip
_FEWEST_FRAMES, _FEWEST_JOINTS = 10, 60
_LEAST = 2  # frames; one may be rounding of frame rates


def late_view(scene: Scene, names: Sequence[str]) -> Hypothesis | None:
    """The view that other frames fit far better, if any: of three views or more.

    Joints of a view are compared with where the others see them, at every shift. Good recordings
    are best at none, or at one frame with nearly the same error.
    """
    count, views = scene.detections.frame_count, range(scene.detections.views)
    if len(views) < 3:
        return None
    first = max(0, (count - _FRAMES) // 2)
    part = torch.arange(first, min(count, first + _FRAMES))
    scene = Scene(scene.cameras.frames(part), scene.detections.frames(part))
    fits = [_best_fit(scene, view) for view in views]
    view = min(views, key=lambda view: fits[view].error / fits[view].now)
    shift, fit = fits[view].shift, fits[view]
    usual = statistics.median(fits[other].now for other in views if other != view)
    if abs(shift) < _LEAST or not fit.error < min(NEARER * fit.now, _LIKE * usual):
        return None
    return Hypothesis(
        names[view],
        f"looks {abs(shift)} or so frames {'late' if shift > 0 else 'early'}",
        "synchronise the videos, and detections with them",
        partial(delayed, view=view, delay=shift),
    )


@dataclass(frozen=True)
class _Fit:
    """How many frames a view is late, and its error, pixels, without that and now."""

    shift: int
    error: float
    now: float


def _best_fit(scene: Scene, view: int) -> _Fit:
    others = [other for other in range(scene.detections.views) if other != view]
    points, _ = scene.select(others).triangulated(rounds=6)
    expected = scene.cameras.select([view]).project(points.nan_to_num())[:, 0]
    known = ~points.isnan().any(-1)
    found = scene.detections.joints2d[:, view]
    seen = scene.detections.confidence2d[:, view] > CONFIDENT
    errors = {
        shift: _error(expected, known, found, seen, shift) for shift in range(-SHIFTS, SHIFTS + 1)
    }
    best = min(errors, key=errors.__getitem__)
    return _Fit(best, errors[best], max(errors[0], _NOTHING))


def _error(expected: Tensor, known: Tensor, found: Tensor, seen: Tensor, shift: int) -> float:
    """Median distance (pixels) of joints ``shift`` frames later from what is expected, (F, 16)."""
    count = len(expected) - abs(shift)
    if count < _FEWEST_FRAMES:
        return float("inf")
    here, there = max(0, -shift), max(0, shift)
    both = known[here : here + count] & seen[there : there + count]
    apart = (expected[here : here + count] - found[there : there + count]).norm(dim=-1)[both]
    return float(apart.median()) if len(apart) >= _FEWEST_JOINTS else float("inf")
