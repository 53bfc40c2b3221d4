"""2D joints that lie on the cells of a heat map, not between them."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity

# Cells of a map that is 64 high are 1.95 % of a person who fills 0.8 of it; the quarters by which
# some decoders heed the next cell leave steps of half of that, which cost next to nothing.
_STEP = 0.018  # of the person's height
_PIXELS = 2.0  # px: whole pixels are no cells
_WIDEST = 5  # times the least step
_OFF, _EXACT = 0.03, 0.01  # share of a step, and px: rounding
_ON = 0.75  # share of the joints of a frame; some are guessed from others
_JOINTS, _FRAMES, _FEWEST = 10, 60, 6  # of a frame; frames looked at; of them on a grid
_MOSTLY = 0.7  # of the frames looked at
_DISTINCT = 3  # columns, or rows, that joints of a frame are in at least


def examine_grid(subject: str, joints: Tensor, confidence: Tensor) -> list[Finding]:
    """Joints that are whole steps apart in each frame, as where maps are largest, cell by cell.

    Args:
        subject: of the finding.
        joints: of a view, (F, 16, 2), pixels.
        confidence: of them, (F, 16).
    """
    seen = (confidence > 0) & joints.isfinite().all(-1)
    frames = (seen.sum(-1) >= _JOINTS).nonzero().flatten()
    frames = frames[:: max(1, len(frames) // _FRAMES)]
    found = []
    for frame in frames.tolist():
        points = joints[frame, seen[frame]]
        height = float(points[:, 1].amax() - points[:, 1].amin())
        across, down = (_step(part, max(_PIXELS, _STEP * height)) for part in points.unbind(-1))
        if across and down:
            found.append((across, height))
    if len(found) < max(_FEWEST, _MOSTLY * len(frames)):
        return []
    step, height = torch.tensor(found).median(0).values.tolist()
    what = (
        f"joints lie on a grid of {step:.3g} px, {step / height:.1%} of the person's height, as "
        "cells of a heat map do"
    )
    remedy = (
        "average around the largest value of each map instead; and if joints are at the corners of "
        f"their cells, all are {0.5 * step:.2g} px too far left and up: add that"
    )
    return [Finding(Severity.WARNING, subject, what, remedy)]


def _step(values: Tensor, least: float) -> float:
    """The largest step, of at least so much, by whole ones of which most values (N,) are apart."""
    apart = (values[:, None] - values).abs()
    steps = apart[(apart >= least) & (apart < _WIDEST * least)].sort().values
    if not len(steps):
        return 0.0
    whole = (apart / steps[:, None, None]).round()
    off = (apart - whole * steps[:, None, None]).abs()
    on = off < (_OFF * steps).clamp(min=_EXACT)[:, None, None]
    share, reference = on.double().mean(-1).max(-1)  # of the values, beside the one that most fit
    for index in (share >= _ON).nonzero().flatten().flip(0).tolist():
        cells = whole[index, reference[index]][on[index, reference[index]]]
        if len(set(cells.tolist())) >= _DISTINCT:
            return float(steps[index])
    return 0.0
