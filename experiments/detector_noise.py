"""How a real 2D detector errs: what ``perfcap.train``'s noise model is fitted to.

OpenPose's joints of a real man in four views, against the projection of his triangulated joints.
The same model's simulated detections are measured the same way beside them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import report
import torch
from recordings import Recording, balancing
from report import Report, Table
from torch import Tensor

from perfcap.train.config import DetectorNoise
from perfcap.train.detector_noise import corrupt

_STANDING = 1.65  # m
_NORMAL = 1.4826  # deviation of a normal variable over its median absolute deviation
_BANDS = ((0.0, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.01))
_FAR = 5.0  # units from a joint's usual place


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    clips: int = 50
    """Simulated clips."""


@dataclass(frozen=True)
class Residuals:
    """Errors (F, N, 16, 2) in units, NaN where unseen, and confidences (F, N, 16)."""

    error: Tensor
    confidence: Tensor


def run(config: Experiment) -> Report:
    """Both tables."""
    real = balancing(config.data)
    pairs = (("OpenPose", _measured(real)), ("simulated", _simulated(real, config.clips)))
    rows = tuple((name, *_summary(residuals)) for name, residuals in pairs)
    columns = (
        *("detections", "offset of a joint", "deviation about it", "change a frame"),
        *("correlation from frame to frame", "farther than 5, %", "unseen, %"),
    )
    sizes = Table("errors in units of 1 % of the person's height", columns, rows, 2)
    names = ("detections", *(f"confidence {low:g} to {min(high, 1):g}" for low, high in _BANDS))
    bands = tuple((name, *_by_confidence(residuals)) for name, residuals in pairs)
    notes = (
        "The triangulation is made from the same detections, which hides part of their errors: "
        "the model is meant to be about a half larger.",
        "Correlation and change are of frames at 30 Hz.",
    )
    return Report((sizes, Table("median error by confidence, units", names, bands, 1)), notes)


def _measured(real: Recording) -> Residuals:
    pixels, unit = _exact(real)
    found = real.detections
    known = real.truth.isfinite().all(-1)[:, None] & (found.confidence2d > 0)
    error = (found.joints2d - pixels) / unit[..., None, None]
    return _at_30_hz(Residuals(torch.where(known[..., None], error, torch.nan), found.confidence2d))


def _simulated(real: Recording, clips: int) -> Residuals:
    pixels, unit = (values[::2].transpose(0, 1).float() for values in _exact(real))  # views first
    generator = torch.Generator().manual_seed(0)
    parts = [
        corrupt(pixels.nan_to_num(0.0), unit, DetectorNoise(), generator) for _ in range(clips)
    ]
    found, confidence = (torch.cat(values).transpose(0, 1) for values in zip(*parts, strict=True))
    error = (found - pixels.repeat(clips, 1, 1, 1).transpose(0, 1)) / unit.repeat(
        clips, 1
    ).transpose(0, 1)[..., None, None]
    return Residuals(torch.where(confidence[..., None] > 0, error, torch.nan), confidence)


def _exact(real: Recording) -> tuple[Tensor, Tensor]:
    """Projected truth (F, C, 16, 2), and the unit there in pixels, (F, C)."""
    local = real.cameras.to_camera(real.truth)
    pixels = real.cameras.project_camera(local)
    depth = local[..., 2].nanmean(-1)
    return pixels, 0.01 * _STANDING * real.cameras.intrinsics[..., 1, 1] / depth


def _at_30_hz(residuals: Residuals) -> Residuals:
    return Residuals(residuals.error[::2], residuals.confidence[::2])


def _summary(residuals: Residuals) -> tuple[float, ...]:
    error = residuals.error
    usual = error.nanmedian(0, keepdim=True).values
    moving = error - usual
    change = moving.diff(dim=0)
    before, after = moving[:-1], moving[1:]
    near = (before.abs() < _FAR).all(-1) & (after.abs() < _FAR).all(-1)
    pair = torch.stack((before[near].flatten(), after[near].flatten()))
    seen = error.isfinite().all(-1)
    far = moving.norm(dim=-1) > _FAR
    return (
        _NORMAL * float(usual.abs().nanmedian()),
        _NORMAL * float(moving.abs().nanmedian()),
        _NORMAL * float(change.abs().nanmedian()),
        float(torch.corrcoef(pair)[0, 1]),
        100 * float(far[seen].float().mean()),
        100 * float((residuals.confidence == 0).float().mean()),
    )


def _by_confidence(residuals: Residuals) -> tuple[float, ...]:
    size = residuals.error.norm(dim=-1)
    inside = [
        size[(residuals.confidence >= low) & (residuals.confidence < high) & size.isfinite()]
        for low, high in _BANDS
    ]
    return tuple(float(values.median()) if len(values) else float("nan") for values in inside)


if __name__ == "__main__":
    report.main(run, Experiment, "detector_noise")
