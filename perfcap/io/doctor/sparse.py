"""Joints that were detected in one of so many frames, and put in between for the others."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity

_ORDER = 4  # differences of this order vanish on straight lines and on cubics
_CORNER = 6.0  # times what vanishes: differences that span an end of a line or a cubic
_LARGEST, _SMALLEST = 0.08, 0.01  # px, of those that vanish: what two decimals and three leave
_LONGEST, _PERIODS = 15, 3  # frames, of a period, and how many there are at least
_MOST, _LOOKED = 0.8, 600  # of what is put in, and frames that are looked at
_SOME = 4  # joints that show a frame


def examine_sparse(name: str, pixels: Tensor, known: Tensor) -> list[Finding]:
    """That a detector ran on one in so many frames, and those between were put in.

    Args:
        name: of the view.
        pixels: joints, (F, 16, 2).
        known: which of them count, (F, 16).
    """
    period = detected_period(pixels.detach(), known)
    if not period:
        return []
    what = (
        f"joints of one in {period} frames were detected, it seems: those between lie on smooth "
        "curves through them, to the last digit"
    )
    remedy = "fast motion is lost so; let the detector look at every frame"
    return [Finding(Severity.WARNING, name, what, remedy)]


def detected_period(pixels: Tensor, known: Tensor) -> int:
    """Every how many frames joints (F, 16, 2) were detected, where others were put in; else 0.

    Fourth differences of lines and cubics do not vanish where they span an end of them, which is
    three in a row.
    """
    if len(pixels) <= _ORDER * _PERIODS:
        return 0
    spread = pixels.diff(n=_ORDER, dim=0).abs().amax(-1)
    held = (pixels.diff(dim=0) == 0).all(-1).unfold(0, _ORDER, 1).all(-1)  # is named elsewhere
    both = known.unfold(0, _ORDER + 1, 1).all(-1) & spread.isfinite() & ~held
    number = (both.sum(-1) >= _SOME).nonzero().flatten()[:_LOOKED]
    spread = torch.where(both, spread, torch.nan)[number]
    for period in range(_ORDER, min(_LONGEST, len(spread) // _PERIODS) + 1):
        for phase in range(period):
            between = (number + phase) % period >= _ORDER - 1
            if bool(between.all()) or not bool(between.any()):
                continue
            ends = float(spread[~between].nanmedian())
            vanishing = float(spread[between].nanquantile(_MOST))
            if vanishing < _LARGEST and ends > max(_SMALLEST, _CORNER * vanishing):
                return period
    return 0
