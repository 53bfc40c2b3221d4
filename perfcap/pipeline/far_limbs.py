"""Arms and legs of a motion that are not where several views see them: frames not to be trusted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.view_words import view_words
from perfcap.geometry.triangulation import triangulate
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.gaps import ranges
from perfcap.pipeline.trust import Trust

# Percent of the person's height in the image beyond what other joints lie off. Right limbs rarely
# have so much in two views, and these then see no two joints in one place.
_FAR, _NEAR = 8.0, 3.0
_OTHERS = 3.0  # times what the median joint of that view lies off in that frame
_SURE = 0.3  # of the usual confidence of a view: detectors mean different things by it
_SAME = 5.0  # percent, at most, from the place that such views agree on
_BORNE_OUT = 3  # views that see a limb where it is; two may agree by chance
_LEAST_FRAMES = 3
_TRUST = 0.3  # at most
_LIMBS = {"arm": ("elbow", "wrist"), "leg": ("knee", "ankle", "toe")}
_OTHER_SIDE = list(LANDMARKS16.mirrored())


@dataclass(frozen=True)
class FarLimb:
    """An arm or a leg that views see where the motion has neither that of the left nor the right.

    Attributes:
        limb: ``arm`` or ``leg``.
        start: its first frame.
        stop: the frame after its last.
        views: that see it elsewhere, counted from 0.
    """

    limb: str
    start: int
    stop: int
    views: tuple[int, ...]

    def words(self, names: Sequence[str] | None = None) -> str:
        """Why its frames are not trusted; views by name where these are known."""
        return (
            f"{view_words(self.views, names)} see{'s' * (len(self.views) == 1)} joints of "
            f"{'an' if self.limb == 'arm' else 'a'} {self.limb} far from both {self.limb}s of the "
            "motion; some views may have left and right exchanged there: look at the overlay, "
            "and leave out or mend those views"
        )


def without_far_limbs(
    trust: Trust, problem: ClipProblem, motions: Sequence[Motion], names: Sequence[str] | None
) -> Trust:
    """Trust that is low where a limb is not where several views see it.

    Args:
        trust: of F frames.
        problem: as of ``judge_motion``.
        motions: the result and that of joints alone, each (F,). Limbs are named that are far in
            all of them: silhouettes may put one right, or aside from wrong joints.
        names: of the views, where known.
    """
    found = tuple(far_limbs(problem, motions))
    if not found:
        return trust
    wrong = torch.zeros_like(trust.value, dtype=torch.bool)
    for each in found:
        wrong[each.start : each.stop] = True
    error = torch.where(wrong, torch.maximum(trust.error, _apart(problem, motions[0])), trust.error)
    value = torch.where(wrong, trust.value.clamp(max=_TRUST), trust.value)
    others = tuple(
        (start + a, start + b, why)
        for start, stop, why in trust.doubtful
        for a, b in ranges(~wrong[start:stop])
    )
    named = []
    for a, b in ranges(wrong):
        inside = [each for each in found if a <= each.start < b]
        named.append((a, b, "; ".join(dict.fromkeys(each.words(names) for each in inside))))
    return replace(trust, value=value, error=error, doubtful=tuple(sorted((*others, *named))))


@torch.no_grad()
def far_limbs(problem: ClipProblem, motions: Sequence[Motion]) -> Iterator[FarLimb]:
    """Limbs that half or more of the views that see them have elsewhere, for three frames or more.

    A joint may be where the motion has that of the other side: a view that exchanges left and
    right, or sees one leg twice, says nothing against a right motion. Where three views bear a
    limb out, others are wrong.

    Args:
        problem: of C views, with detections (F, C).
        motions: one or more, (F,).
    """
    if problem.detections.views < 2:
        return
    errors = [_errors(problem, motion) for motion in motions]
    sure = _sure(problem)
    for limb in _LIMBS:
        parts = [_far(problem, error, sure, limb) for error in errors]
        level = torch.stack([each[0] for each in parts]).amin(0)
        for start, stop in ranges(level > _NEAR):  # frames beside, too, that are less far off
            far = [b - a for a, b in ranges(level[start:stop] > _FAR)]
            if far and max(far) >= _LEAST_FRAMES:
                # of the frames in which limbs are clearly elsewhere
                apart = parts[0][1][start:stop] > _FAR
                views = torch.nonzero(apart.sum(0) * 2 >= max(far)).flatten().tolist()
                yield FarLimb(limb, start, stop, tuple(views))


def _errors(problem: ClipProblem, motion: Motion) -> tuple[Tensor, Tensor]:
    """Distance of detected joints from those of either side, (F, C, 16), and of most, (F, C).

    Percent of the person's height; most joints are measured from those of their own side.
    """
    seen = problem.detections.joints2d
    places = problem.cameras.project(problem.actor.joints(motion))
    sides = [(each - seen).norm(dim=-1) for each in (places, places[..., _OTHER_SIDE, :])]
    own, other = (each / problem.pixel_unit[:, None] for each in sides)
    known = problem.detections.confidence2d > 0
    return torch.minimum(own, other), torch.where(known, own, torch.nan).nanmedian(-1).values


def _sure(problem: ClipProblem) -> Tensor:
    """Joints that a view sees about as surely as usual, (F, C, 16)."""
    confidence = problem.detections.confidence2d
    known = torch.where(confidence > 0, confidence, torch.nan)
    usual = known.transpose(0, 1).flatten(1).nanmedian(-1).values  # C
    return (confidence > 0) & (confidence >= _SURE * usual[:, None])


def _far(
    problem: ClipProblem, errors: tuple[Tensor, Tensor], sure: Tensor, limb: str
) -> tuple[Tensor, Tensor]:
    """How far half of the views have a limb from where it is, (F,), and each view, (F, C).

    Percent of the person's height beyond what other joints lie off; -inf where few views see it,
    enough of them see it there, or the others agree on no other place. The error of a limb is its
    second largest: one joint may err.
    """
    error, usual = errors
    sides = [[LANDMARKS.index(f"{side}_{name}") for name in _LIMBS[limb]] for side in "lr"]
    least = torch.where(sure, error, -torch.inf).nan_to_num(-torch.inf)
    seconds = torch.stack([least[..., side].topk(2, -1).values[..., 1] for side in sides])
    worst, side = seconds.max(0)
    each = (worst - _OTHERS * usual).nan_to_num(-torch.inf, posinf=0.0)
    shown = each > -torch.inf
    count, near = shown.sum(-1), (shown & (each <= _NEAR)).sum(-1)
    half = ((count + 1) // 2).clamp(min=2)  # that many views have it as far off, or farther
    ranked = each.sort(-1, descending=True).values
    level = ranked.gather(-1, half[:, None] - 1)[:, 0]
    joints = torch.tensor(sides, device=side.device)[side]  # F C N, of the side that is farther off
    off = sure & (error > _NEAR)
    judged = (count >= 2) & (near < _BORNE_OUT) & _agree(problem, joints, off, each > _NEAR)
    return torch.where(judged, level, -torch.inf), each


def _agree(problem: ClipProblem, joints: Tensor, off: Tensor, far: Tensor) -> Tensor:
    """Frames (F,) in which views that are far (F, C) see two joints (F, C, N) in one place each.

    Of those that are off (F, C, 16) in them; views may call them left or right.
    """
    seen = problem.detections.joints2d
    pixels = seen.gather(2, joints[..., None].expand(*joints.shape, 2))
    counts = (off.gather(2, joints) & far[..., None]).to(pixels)
    points, _ = triangulate(problem.cameras, problem.cameras.to_plane(pixels), counts)
    error = (problem.cameras.project(points) - pixels).norm(dim=-1) / problem.pixel_unit[:, None]
    same = (counts > 0) & (error < _SAME)  # NaN is no number below
    agree: Tensor = (same.sum(1) >= 2).sum(-1) >= 2
    return agree


def _apart(problem: ClipProblem, motion: Motion) -> Tensor:
    """Mean distance of joints from where the view that they are farthest off in sees them, (F,) mm.

    Image distances at the distance of the person, whose height is the actor's at rest.
    """
    rest = problem.actor.skeleton.rest_landmarks[:, 1]
    error = torch.where(_sure(problem), _errors(problem, motion)[0], 0).nan_to_num(0)
    mean = error.mean(-1).amax(-1)  # percent of the height, F
    apart: Tensor = 10 * (rest.max() - rest.min()) * mean
    return apart
