"""What a first solve of a clip tells the second: errors, priors, and where feet stand.

A weight should be the reciprocal of a variance. Detectors give confidences instead, and settings
state deviations for detectors as they mostly are. Residuals after a first solve tell both: the
median squared error of the joints of like confidence is their variance, whatever a confidence means
to its network, and medians do not notice exchanged limbs and outliers. They are taken in bins of
equal count, made to fall with confidence, and interpolated.

Deviations are root mean squares with the tails of a network's errors, and medians know no tails:
errors of a network are nominal at the shares of the stated variance that are constants here.
Smaller ones raise the weight. Larger ones do not lower it, because a motion that the first solve
smoothed away leaves large residuals as well.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.pipeline.clip_problem import ClipProblem, FirstSolve, WindowData
from perfcap.pipeline.config import PositionConfig
from perfcap.pipeline.prior_evidence import evident_stiffness
from perfcap.pipeline.stances import translation_precision
from perfcap.pipeline.standing import find_standing
from perfcap.temporal.window import Window, partition

_STRETCH = 500  # frames whose errors are looked at together
_SEEN_THROUGH = ("joints2d", "joints3d", "targets")  # energies whose errors have a size
_BINS = 10
_LEAST_PER_BIN = 20
_CHI2 = {2: 1.386, 3: 2.366}  # median squared norm of standard normal vectors
_NOMINAL = {2: 0.43, 3: 0.25}  # of the stated variance, by median: simulated networks
_LARGEST = 100.0  # gain: a tenth of the stated deviation


def adapted(problem: ClipProblem, motion: Motion) -> ClipProblem:
    """The problem with weights from the sizes of its errors and a prior that its windows ask for.

    Confidences keep their graph; sizes and prior are constants.

    Args:
        problem: the clip, before its first solve.
        motion: what that found, (F,).
    """
    motion = motion.detach()
    squared = _squared_errors(problem, motion)
    detections, certain = problem.detections, problem.certain
    if "joints2d" in squared:
        confidence = calibrated(detections.confidence2d, squared["joints2d"])
        detections = replace(detections, confidence2d=confidence)
    if certain is not None and "targets" in squared:
        certain = certain * gain(squared["targets"], certain > 0, 3)
    gain3d, width3d = 1.0, 1.0
    if "joints3d" in squared:
        trusted = detections.trusted3d[..., None].expand(squared["joints3d"].shape)
        gain3d = gain(squared["joints3d"], trusted, 3)
        width3d = _width(problem.config.position, squared["joints3d"], trusted)
    windows = partition(motion.frames, problem.config.window, problem.config.overlap)
    starts = tuple(window.start for window in windows)
    first = FirstSolve(starts, _stated(problem, len(starts)), gain3d, width3d)
    known = replace(problem, detections=detections, certain=certain, first=first)
    return replace(known, first=replace(first, stiffness=_stiffness(known, motion, windows)))


@torch.no_grad()
def with_standing(problem: ClipProblem, motion: Motion) -> ClipProblem:
    """The problem with the floor and the stances of a motion (F,), if feet stand on a floor."""
    joints = replace(problem, terms={}, first=None)
    parts = [
        translation_precision(
            [dict(joints.objective(stretch).items())["joints2d"]], motion[stretch.index]
        )
        for stretch in _stretches(motion)
    ]
    settings = problem.rate, problem.config.contact, torch.cat(parts), problem.cameras, problem.up
    return replace(problem, standing=find_standing(problem.actor, motion, *settings))


def _stretches(motion: Motion) -> list[Window]:
    """Parts of a motion that are looked at together."""
    starts = range(0, motion.frames, _STRETCH)
    return [Window(start, min(start + _STRETCH, motion.frames)) for start in starts]


def _stated(problem: ClipProblem, windows: int) -> Tensor:
    """The prior of ``config`` for every window, (W, 2 + A)."""
    lower = problem.actor.skeleton.lower
    return lower.new_ones(windows, 2 + len(lower))


def _width(config: PositionConfig, squared: Tensor, trusted: Tensor) -> float:
    """Share of the variance of 3D joints that a kernel is to have, as wide as errors are."""
    if config.scale is None:
        return 1.0
    return max(min(1.0, variance(squared, trusted, 3)), 1e-4)


@torch.no_grad()
def _squared_errors(problem: ClipProblem, motion: Motion) -> dict[str, Tensor]:
    """Squared errors in their unit, confidence aside, (F, C, 16) of every energy that has them."""
    joints = replace(problem, terms={})
    found: dict[str, Tensor] = {}
    for stretch in _stretches(motion):
        part = motion[stretch.index]
        for name, energy in joints.objective(stretch).items():
            if name in _SEEN_THROUGH:
                errors = energy.residual(part).value.square().sum(-1)
                errors = errors.reshape(len(errors), -1, len(LANDMARKS))
                whole = errors.new_full((motion.frames, *errors.shape[1:]), torch.nan)
                found.setdefault(name, whole)[stretch.index] = errors
    return found


@torch.no_grad()
def _stiffness(problem: ClipProblem, motion: Motion, windows: list[Window]) -> Tensor:
    """Of every window, from the evidence, (W, 2 + A)."""
    found = []
    for start in range(0, len(windows), problem.config.batch):
        group = windows[start : start + problem.config.batch]
        objective = problem.objective_of(WindowData.stack([problem.at(w) for w in group]))
        state = Motion.stack([motion[window.index] for window in group])
        found.append(evident_stiffness(objective, state, problem.config))
    return torch.cat(found)


# --- Sizes of errors ------------------------------------------------------------------------------


def calibrated(confidence: Tensor, squared: Tensor) -> Tensor:
    """Confidences that are reciprocals of variances, in the stated one.

    What a confidence is multiplied by is a constant: gradients reach every confidence.

    Args:
        confidence: any shape; 0 stays 0.
        squared: squared errors of 2D joints in their stated deviation, likewise.
    """
    with torch.no_grad():
        given = confidence.detach()
        seen = (given > 0) & squared.isfinite()
        if int(seen.sum()) < 2 * _LEAST_PER_BIN:
            return confidence
        own = given.clamp(min=1e-9).log()
        precision = (-_interpolate(own, *_bins(own[seen], squared[seen]))).exp()
        # the mean weight is the detector's own, but for what the gain says
        precision = precision * (given[seen].sum() / precision[seen].sum())
        precision = precision * gain(precision * squared, seen, 2)
        factor = torch.where(seen, precision / given.clamp(min=1e-9), 0.0)
    return confidence * factor


def gain(squared: Tensor, seen: Tensor, entries: int) -> float:
    """Factor on the weight of groups whose errors are smaller than nominal, from 1 on."""
    return min(max(1.0, _NOMINAL[entries] / max(variance(squared, seen, entries), 1e-9)), _LARGEST)


def variance(squared: Tensor, seen: Tensor, entries: int) -> float:
    """Median squared norm of groups of ``entries`` over that of standard normal ones; 1 if none."""
    known = squared[seen & squared.isfinite()]
    return float(known.median()) / _CHI2[entries] if len(known) >= _LEAST_PER_BIN else 1.0


def _bins(at: Tensor, squared: Tensor) -> tuple[Tensor, Tensor]:
    """Places of the bins and the logarithm of their variance, which does not rise."""
    order = at.argsort()
    parts = order.tensor_split(max(2, min(_BINS, len(order) // _LEAST_PER_BIN)))
    knots = torch.stack([at[part].mean() for part in parts])
    medians = torch.stack([squared[part].median() for part in parts])
    levels = (medians / _CHI2[2]).clamp(min=1e-9).log()
    return knots, levels.flip(0).cummax(0).values.flip(0)


def _interpolate(at: Tensor, knots: Tensor, levels: Tensor) -> Tensor:
    """Linear between knots, constant beyond them."""
    right = torch.searchsorted(knots, at.contiguous()).clamp(1, len(knots) - 1)
    low, high = knots[right - 1], knots[right]
    share = ((at - low) / (high - low).clamp(min=1e-9)).clamp(0, 1)
    return levels[right - 1] + share * (levels[right] - levels[right - 1])
