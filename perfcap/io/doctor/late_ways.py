"""Ways of all moving cameras that are some frames late against the joints of their views."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.io.doctor.evidence import Scene, disagreement_of, joint_residuals, person_height
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.hypotheses import SHORT

SHIFTS = 15  # frames looked at, both ways
TIMES = 1.3  # ways are late if views disagree by so many times less once they are not
_ALONE = 1.05  # and by so many times less than if those of one view are, or its joints
_LEAST = 2  # frames; one may be rounding of frame rates
_FEWEST = 20  # frames that joints have poses for, at any shift
_FRAMES = 40  # of these that are looked at, evenly spread
_NOTHING = 1e-6  # px
_EXACT = 0.002  # of the person's height: views that disagree by less are in time


@dataclass(frozen=True)
class LateWays:
    """How many frames late the ways are, and by what views disagree, pixels, now and if undone."""

    delay: int
    now: float
    rest: float

    def undo(self, scene: Scene) -> Scene:
        """Each frame with its own poses; joints of frames that have none are not seen."""
        frames = torch.arange(scene.detections.frame_count)
        own = frames + self.delay
        there = (own >= 0) & (own < len(frames))
        seen = scene.detections
        confidence = torch.where(there[:, None, None], seen.confidence2d, 0)
        return Scene(
            scene.cameras.frames(own.clamp(0, len(frames) - 1)),
            Detections(seen.joints2d, confidence, None, seen.trusted3d),
        )

    def finding(self, names: Sequence[str]) -> Finding:
        """What to say of views with these names; where their joints are is then not known."""
        way = "late" if self.delay > 0 else "early"
        what = (
            f"the ways of all cameras look {abs(self.delay)} or so frames {way} against the joints "
            f"(in time, views disagree by {self.rest:.1f} instead of {self.now:.1f} px)"
        )
        remedy = "give the pose of each frame to that frame, of as many frames as joints have"
        views = tuple(range(len(names)))
        return Finding(Severity.ERROR, "camera poses", what, remedy, views=views)


def late_ways(scene: Scene) -> LateWays | None:
    """Whether views agree far better with the poses of other frames, the same in all views.

    Joints of the same frames are compared with both. Nothing shows it where cameras stand, and
    what poses or joints of one view alone explain nearly as well is not of all. In a short clip,
    slow errors may be as large as what cameras move.

    Args:
        scene: C views, (F, C).
    """
    if not scene.cameras.moving or scene.detections.views < 2:
        return None
    if scene.detections.frame_count < SHORT:
        return None
    sure = scene.sure()
    most = min(SHIFTS, scene.detections.frame_count - _FEWEST)
    height, residuals = person_height(sure.sampled()), joint_residuals(sure)
    if not disagreement_of(sure, residuals) > _EXACT * height:
        return None
    fits = [_fit(sure, residuals, shift) for shift in range(-most, most + 1) if shift]
    best = max(fits, key=lambda fit: fit.now / fit.rest)
    if abs(best.delay) < _LEAST or not best.now > TIMES * best.rest < math.inf:
        return None
    return None if _of_one_view(sure, best, most) else best


def _common(count: int, shift: int) -> Tensor:
    """Frames for which there are poses ``shift`` frames later."""
    common = torch.arange(max(0, -shift), count - max(0, shift))
    if len(common) <= _FRAMES:
        return common
    return common[torch.linspace(0, len(common) - 1, _FRAMES).round().long()]


def _fit(scene: Scene, residuals: Tensor, shift: int) -> LateWays:
    """What views disagree by with these poses, and with those ``shift`` frames later."""
    frames = _common(scene.detections.frame_count, shift)
    moved = Scene(scene.cameras.frames(frames + shift), scene.detections.frames(frames))
    now = disagreement_of(scene, residuals[frames])
    rest = disagreement_of(scene, joint_residuals(moved))
    return LateWays(shift, now, max(rest, _NOTHING))


def _of_one_view(scene: Scene, best: LateWays, most: int) -> bool:
    """Whether poses of one view, or its joints, at another time explain nearly as much."""
    count = scene.detections.frame_count
    common = _common(count, best.delay)
    undone = _joined(scene, common, [best.delay] * scene.detections.views)
    for view in range(scene.detections.views):
        for shift in range(-most, most + 1):
            there = (common + shift >= 0) & (common + shift < count)
            if not shift or int(there.sum()) < _FEWEST:
                continue
            one = [shift if each == view else 0 for each in range(scene.detections.views)]
            poses = _joined(scene, common[there], one)
            late = _joined(scene, common[there], [0] * len(one), one)
            # joints that are not seen at one of the two times count for none
            least = min(_together(undone[there], each, scene) for each in (poses, late))
            if least < _ALONE:
                return True
    return False


def _joined(
    scene: Scene, frames: Tensor, poses: Sequence[int], joints: Sequence[int] | None = None
) -> Tensor:
    """Residuals (F, 16) of frames with poses, and joints, so many frames later in each view."""
    views = torch.arange(scene.detections.views)
    then = frames[:, None] + torch.tensor(poses)
    seen = frames[:, None] + torch.tensor([0] * len(views) if joints is None else joints)
    cameras = scene.cameras.map(lambda each: each[then, views])
    found = scene.detections
    detections = Detections(
        found.joints2d[seen, views],
        found.confidence2d[seen, views],
        None,
        found.trusted3d[seen, views],
    )
    return joint_residuals(Scene(cameras, detections))


def _together(undone: Tensor, other: Tensor, scene: Scene) -> float:
    """How many times more the other residuals are, where both are known."""
    known = ~undone.isnan() & ~other.isnan()
    one, another = (disagreement_of(scene, each[known]) for each in (undone, other))
    return another / max(one, _NOTHING) if math.isfinite(one) else math.inf
