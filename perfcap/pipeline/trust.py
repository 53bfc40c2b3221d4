"""How far each frame of a motion can be trusted: what the solve itself shows of its errors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.gaps import ranges
from perfcap.pipeline.trust_weights import FEATURES, SEVERAL, weighted
from perfcap.solve.energy import Energy

THRESHOLD = 0.7  # of trust, below which frames are named
_DOUBTED = "a check of the inputs contradicts joints, and the others do not bear the motion out"
_BESIDE = "limbs are far from where joints that several views agree on have them"
_FAR_LIMB = 0.3  # m beside the middle of the hips: no two such poses of a frame can both be good
_PAIR = 2  # views
_UNSHOWN = 0.5  # trust, at most, in frames of which every joint is doubted: more than half are bad
_CONSIDERABLE = 0.25  # of the frames
_NAMED = 6  # ranges in words
_FEW = math.log(0.15)  # log of detections that agree
_FAR_OFF = math.log(4.0)  # log percent of the person's height
_ELSEWHERE = math.log(0.14)  # log m
_UNSURE = math.log(0.1)  # m
_STRETCH = 200  # frames whose covariances are held at once
_AROUND = 0.1  # s, of frames that a frame is judged with
_OUTLIER, _LOST = 4.0, 20.0  # percent of the person's height: a detection that does not agree
_ENOUGH = 1.0  # detections that agree with a joint
_HARDLY = 0.3  # of one, in the median frame
_BASE = 0.3  # percent of the person's height: no error is known better
_TYPICAL_SPACE = 0.06  # m, where there is no 3D pose to differ from
_LACKED = ("head_top", "neck", "r_toe", "l_toe")  # by COCO's joints, among others
_LIMBS = [place for place, name in enumerate(LANDMARKS) if name not in _LACKED]
_DAMPING = 1e-6  # relative to the largest curvature


@torch.no_grad()
def frame_evidence(problem: ClipProblem, motion: Motion) -> Tensor:
    """What tells good frames from bad ones, (F, 10), in the order of ``FEATURES``.

    Means over a tenth of a second to either side of:

    - pixels: log of the median reprojection error, in percent of the person's height, and
      worst_pixels: that of the joint with the largest one;
    - support and least_support: how many detections agree with a joint, an outlier counts for
      nothing and more than one is as good as one; the mean over joints, and the log of the least.
      Crown, neck and toes do not count in a clip that never shows them, or whose several views
      hardly ever agree with them, nor in worst_pixels;
    - space and worst_space: log distance (m) between joints and 3D poses, mean and largest, and
      no_space: 1 where no 3D pose is trusted;
    - spread: log of the largest deviation (m) of a joint about the mean of all, from the
      covariance of the solve (the inverse curvature of its data and its pose prior);
    - views: log of one plus the number of views that see the person;
    - deviation: log of the error (m) that 3D poses are expected to have, the least of all views;
      NaN where nothing says.

    What detectors call confidence is not used: they mean different things by it.

    Args:
        problem: as it was before a first solve changed its weights.
        motion: the result, (F,).
    """
    reach, counted = _reach(problem, motion), _counted(problem, motion)
    parts = []
    for start in range(0, motion.frames, _STRETCH):
        first, stop = max(0, start - reach), min(motion.frames, start + _STRETCH + reach)
        part = slice(first, stop)
        found = _evidence(problem, motion[part], part, reach, counted)
        parts.append(found[start - first : start - first + _STRETCH])
    return torch.cat(parts)


def _evidence(
    problem: ClipProblem, motion: Motion, part: slice, reach: int, counted: Tensor
) -> Tensor:
    frames = problem.apart(part)
    seen, unit = frames.detections, problem.pixel_unit
    known, energies = seen.confidence2d > 0, dict(frames.objective().items())
    error = _pixels_off(frames.cameras, seen, problem.actor.joints(motion), unit)
    agrees = _agreement(error, known)
    count = known.sum(1)
    of_joints = error.sum(1) / count.clamp(min=1)  # F J
    support = _around(agrees, reach)[:, counted]
    space, worst, none = _space(energies, problem, seen.trusted3d, motion)
    middle = torch.where(count > 0, of_joints, torch.nan).nanmedian(-1).values.nan_to_num(_LOST)
    features = (
        (_around(middle, reach) + _BASE).log(),
        (_around(of_joints, reach)[:, counted].amax(-1) + _BASE).log(),
        support.mean(-1),
        (support.amin(-1) + 0.05).log(),
        (_around(space, reach) + 0.01).log(),
        (_around(worst, reach) + 0.01).log(),
        _around(none, reach),
        (_spread(list(energies.values()), problem, motion, reach) + 1e-3).log(),
        _around(known.any(-1).sum(-1).to(unit).log1p(), reach),
        _around(_deviation(seen), reach).log(),
    )
    return torch.stack(features, -1)


def _pixels_off(cameras: Camera, seen: Detections, joints: Tensor, unit: Tensor) -> Tensor:
    """Reprojection errors (F, C, J) in percent of the person's height; 0 where nothing is seen."""
    pixels = (cameras.project(joints) - seen.joints2d).norm(dim=-1)
    error = (pixels / unit[:, None]).nan_to_num(_LOST, _LOST).clamp(max=_LOST)
    return torch.where(seen.confidence2d > 0, error, 0)


def _agreement(error: Tensor, known: Tensor) -> Tensor:
    """How many detections agree with a joint, (F, J), 1 at most; both are (F, C, J)."""
    agrees = known / (1 + (error / _OUTLIER).square()).square()
    return agrees.sum(1).clamp(max=_ENOUGH)


def _counted(problem: ClipProblem, motion: Motion) -> Tensor:
    """Joints (J,) that evidence looks at: limbs, and others that the clip shows.

    Detectors and actors have necks and crowns at other places: one that several views hardly ever
    bear out is defined otherwise, which says nothing of a frame.
    """
    seen = problem.detections
    known = seen.confidence2d > 0  # F C J
    counted = known.any(0).any(0)
    if seen.views > 1:
        joints = problem.actor.joints(motion)
        error = _pixels_off(problem.cameras, seen, joints, problem.pixel_unit)
        agrees = torch.where(known.any(1), _agreement(error, known), torch.nan)
        counted &= agrees.nanmedian(0).values > _HARDLY
    counted[_LIMBS] = True  # limbs that nothing shows are hidden; others, the joint set may lack
    return counted


def _deviation(seen: Detections) -> Tensor:
    """Expected error of the best 3D pose of each frame, (F,) metres; NaN where unknown."""
    if seen.deviation3d is None:
        return torch.full_like(seen.confidence2d[:, 0, 0], torch.nan)
    known = seen.trusted3d & seen.deviation3d.isfinite()
    least = torch.where(known, seen.deviation3d, torch.inf).amin(-1)
    return torch.where(least.isfinite(), least, torch.nan)


def _reach(problem: ClipProblem, motion: Motion) -> int:
    """Frames to either side that a frame is judged with."""
    return max(0, round(min(_AROUND * problem.rate, motion.frames)))


def _around(values: Tensor, reach: int) -> Tensor:
    """Means over so many frames to either side of values (F, ...)."""
    flat = values.reshape(len(values), -1).mT[None]
    padded = torch.nn.functional.pad(flat, (reach, reach), mode="replicate")
    mean: Tensor = torch.nn.functional.avg_pool1d(padded, 2 * reach + 1, 1)[0].mT
    return mean.reshape(values.shape)


def _space(
    energies: dict[str, Energy[Motion]], problem: ClipProblem, trusted: Tensor, motion: Motion
) -> tuple[Tensor, Tensor, Tensor]:
    """Mean and largest distance from 3D poses (m), and 1 where none is trusted, each (F,)."""
    counts = trusted.to(problem.pixel_unit)
    if "joints3d" not in energies:
        typical = torch.full_like(counts[:, 0], _TYPICAL_SPACE)
        return typical, 2 * typical, torch.ones_like(typical)
    value = energies["joints3d"].residual(motion).value.norm(dim=-1)
    deviation = value.new_tensor(problem.config.position.deviation)
    apart = value.reshape(*trusted.shape, -1) * deviation  # F C J
    total = counts.sum(-1)
    of_joints = (apart * counts[..., None]).sum(1) / total.clamp(min=1)[:, None]
    none = total == 0
    mean = torch.where(none, _TYPICAL_SPACE, of_joints.mean(-1))
    return mean, torch.where(none, 2 * _TYPICAL_SPACE, of_joints.amax(-1)), none.to(mean)


def _spread(
    energies: list[Energy[Motion]], problem: ClipProblem, motion: Motion, reach: int
) -> Tensor:
    """Largest deviation of a joint about the mean of all, (F,), metres."""
    curvature = torch.stack([frame_curvature(energy, motion) for energy in energies]).sum(0)
    total = _around(curvature, reach)
    scale = total.diagonal(dim1=-2, dim2=-1).amax(-1)[:, None, None]
    eye = torch.eye(total.shape[-1]).to(total)
    covariance = torch.linalg.inv(total + _DAMPING * scale.clamp(min=1e-9) * eye)
    _, joints, _ = problem.actor.skeleton.linearize(motion)
    relative = joints - joints.mean(-3, keepdim=True)  # F J 3 D
    variance = ((relative @ covariance[:, None]) * relative).sum((-2, -1))
    largest: Tensor = variance.clamp(min=0).sqrt().amax(-1)
    return largest


def frame_curvature(energy: Energy[Motion], motion: Motion) -> Tensor:
    """Gauss-Newton matrix of an energy in each frame, (F, D, D)."""
    linear = energy.linearize(motion)
    slope = energy.kernel.slope(linear.residual.squared_norm())
    if linear.residual.confidence is not None:
        slope = slope * linear.residual.confidence
    rows = (linear.frame * (energy.weight.to(slope) * slope).sqrt()[..., None, None]).flatten(1, 2)
    matrix: Tensor = rows.mT @ rows
    return matrix


@dataclass(frozen=True)
class Trust:
    """How far each frame can be trusted.

    Attributes:
        value: probability that a frame is good, (F,): no joint 0.3 m off beside the middle of the
            hips, and 120 mm or less after a similarity.
        error: expected error after a similarity, (F,), millimetres.
        doubtful: half-open ranges of frames below ``THRESHOLD``, and why.
    """

    value: Tensor
    error: Tensor
    doubtful: tuple[tuple[int, int, str], ...]

    @property
    def considerable(self) -> bool:
        """Whether more than a quarter of the frames is not trusted."""
        count = sum(stop - start for start, stop, _ in self.doubtful)
        return count > _CONSIDERABLE * len(self.value)

    def report(self, first_frame: int = 0) -> dict[str, Any]:
        """As plain values, for run.json."""
        return {
            "trusted": not self.considerable,
            "mean_trust": round(float(self.value.mean()), 4),
            "threshold": THRESHOLD,
            "expected_error_mm": [round(value, 1) for value in self.error.tolist()],
            "not_trusted": [
                {"frames": [a + first_frame, b + first_frame], "reason": why}
                for a, b, why in self.doubtful
            ],
        }

    def sentences(self, first_frame: int = 0) -> Iterator[str]:
        """The ranges in words, the longest ones."""
        ranked = sorted(self.doubtful, key=lambda each: each[0] - each[1])[:_NAMED]
        for start, stop, why in sorted(ranked):
            error = float(self.error[start:stop].mean())
            first, last = first_frame + start, first_frame + stop - 1
            which = f"frames {first} to {last} are" if last > first else f"frame {first} is"
            yield f"{which} not to be trusted (expected error {error:.0f} mm): {why}"
        if len(self.doubtful) > _NAMED:
            yield f"{len(self.doubtful) - _NAMED} shorter ranges are in run.json"


def judge_motion(problem: ClipProblem, motion: Motion, joints: Motion | None = None) -> Trust:
    """Trust in a motion: no more in any frame than what joints that are not doubted bear out.

    Args:
        problem: as of ``frame_evidence``.
        motion: the result, (F,).
        joints: the motion from joints alone, (F,), where images changed it. Where three views or
            more bear that out, and limbs lie elsewhere, the result is wrong.
    """
    found = _judged(problem, motion)
    return found if joints is None else _beside(problem, found, motion, joints)


def _judged(problem: ClipProblem, motion: Motion) -> Trust:
    evidence = frame_evidence(problem, motion)
    judged, doubted = judge_frames(evidence), problem.detections.doubted
    if doubted is None or not bool(doubted.any()):
        return judged
    # means over time are not to lean on the frames beside
    near = _around(doubted.double(), _reach(problem, motion)) > 0
    others = replace(problem.detections, doubted=near).undoubted()
    borne_out = judge_frames(frame_evidence(replace(problem, detections=others), motion))
    shown = (others.confidence2d > 0).flatten(1).any(1) | others.trusted3d.any(1)
    most = torch.where(shown, borne_out.value, borne_out.value.clamp(max=_UNSHOWN))
    worse = doubted.any(-1) & ~(most >= judged.value)
    value = torch.where(worse, most, judged.value)
    error = torch.where(worse, torch.maximum(borne_out.error, judged.error), judged.error)
    doubtful = tuple(
        (a, b, _DOUBTED if bool(worse[a:b].any()) else _reason(evidence[a:b].mean(0)))
        for a, b in ranges(~(value >= THRESHOLD))
    )
    return Trust(value, error, doubtful)


@torch.no_grad()
def _beside(problem: ClipProblem, found: Trust, motion: Motion, joints: Motion) -> Trust:
    """Trust in frames whose limbs images put far from where trusted joints have them."""
    places = [problem.actor.joints(each) for each in (motion, joints)]
    one, other = (each - mid_hip(each)[:, None] for each in places)
    apart = (one - other).norm(dim=-1)  # F J
    far = apart.amax(-1) > _FAR_LIMB
    if not bool(far.any()):
        return found
    # of one view silhouettes show limbs that no network sees, and two may agree on a wrong place
    several = (problem.detections.confidence2d > 0).any(-1).sum(-1) > _PAIR
    borne_out = _judged(problem, joints).value
    wrong = far & several & (borne_out >= THRESHOLD)
    value = torch.where(wrong, torch.minimum(found.value, 1 - borne_out), found.value)
    error = torch.where(wrong, torch.maximum(found.error, 1000 * apart.mean(-1)), found.error)
    named = [(a, b, _BESIDE) for a, b in ranges(wrong)]
    return Trust(value, error, tuple(sorted(_cut(found.doubtful, wrong) + named)))


def _cut(doubtful: tuple[tuple[int, int, str], ...], taken: Tensor) -> list[tuple[int, int, str]]:
    """What is left of ranges outside frames (F,) that are named otherwise."""
    return [
        (start + a, start + b, why)
        for start, stop, why in doubtful
        for a, b in ranges(~taken[start:stop])
    ]


def judge_frames(evidence: Tensor) -> Trust:
    """Trust from the evidence of each frame, (F, 10)."""
    bad, error = weighted(evidence)
    value, error = torch.sigmoid(-bad), error.exp()
    spans = ranges(~(value >= THRESHOLD))  # what is no number is not trusted
    doubtful = tuple((a, b, _reason(evidence[a:b].mean(0))) for a, b in spans)
    return Trust(value, error, doubtful)


def _reason(evidence: Tensor) -> str:
    """What is most unusual about frames with this mean evidence."""
    found = dict(zip(FEATURES, evidence.tolist(), strict=True))
    if found["least_support"] < _FEW:
        return "joints are not detected, or nothing agrees with their detections"
    if found["pixels"] > _FAR_OFF:
        return "the motion does not project onto the detected joints"
    if found["no_space"] > 0.5 and found["views"] < SEVERAL:
        return "one view without 3D poses that can be trusted, where depth is a guess"
    if found["deviation"] > _UNSURE and found["views"] < SEVERAL:
        return "what gave the 3D poses of the one view is not sure of them"
    if found["space"] > _ELSEWHERE:
        return "the 3D poses disagree with the motion"
    return "detections contradict each other or leave the pose open"
