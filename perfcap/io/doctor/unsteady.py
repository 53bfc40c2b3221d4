"""Joints that turn or grow as a whole from frame to frame, as images that training varies do."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity

_JOINTS, _FRAMES = 8, 8  # that two frames share; and frames, with both beside them, that show it
# Of changes of changes, means: people stay far below, at a few frames a second too
_TURNED, _GROWN = math.radians(15), 0.2
_BACK = 1.0  # times the changes themselves: who spins goes on
_MOST = 0.9  # of the changes, that count


def examine_unsteady(subject: str, pixels: Tensor, known: Tensor) -> list[Finding]:
    """That each frame is turned or scaled by itself: nobody turns there and back so fast.

    Args:
        subject: of the finding.
        pixels: joints, (F, 16, 2).
        known: which of them count, (F, 16).
    """
    turned, grown = _changes(pixels.detach(), known)
    turn, size = _there_and_back(turned), _there_and_back(grown)
    if math.hypot(turn / _TURNED, size / _GROWN) < 1:
        return []
    what = (
        f"the person turns by {math.degrees(turn):.0f} degrees in the image and grows by "
        f"{100 * math.expm1(size):.0f} % from frame to frame, there and back (means)"
    )
    remedy = (
        "nobody moves so; was each image turned or scaled by itself, as training varies them? Take "
        "joints back to the image as it was filmed, and give the affine map of each frame"
    )
    return [Finding(Severity.WARNING, subject, what, remedy)]


def _changes(pixels: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Angle and logarithm of the scale from frame to frame, (F - 1,); NaN where joints are few."""
    places = torch.view_as_complex(pixels.double().nan_to_num().contiguous())
    both = (known[1:] & known[:-1]).double()
    count = both.sum(-1, keepdim=True)
    before, after = (
        (part - (part * both).sum(-1, keepdim=True) / count.clamp(min=1)) * both
        for part in (places[:-1], places[1:])
    )
    turned = (before.conj() * after).sum(-1).angle()
    grown = 0.5 * (after.abs().square().sum(-1).log() - before.abs().square().sum(-1).log())
    few = (count[:, 0] < _JOINTS) | ~grown.isfinite()
    return turned.masked_fill(few, torch.nan), grown.masked_fill(few, torch.nan)


def _there_and_back(changes: Tensor) -> float:
    """Mean change of changes (N,), where it is larger than they are; else 0."""
    other = changes.diff().abs()
    seen = other.isfinite()
    if int(seen.sum()) < _FRAMES:
        return 0.0
    mean = _mean(other[seen])
    return mean if mean > _BACK * _mean(changes[1:][seen].abs()) else 0.0


def _mean(values: Tensor) -> float:
    """Without the largest: those of a joint that is lost, or of a person who is exchanged."""
    return float(values.sort().values[: max(1, int(_MOST * len(values)))].mean())
