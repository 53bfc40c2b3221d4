"""Where a clip is put together of parts that do not follow one another."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS16
from perfcap.io.doctor.body_size import body_size
from perfcap.io.doctor.finding import Finding, Severity, ranges
from perfcap.io.doctor.paths import WINDOW, meeting, peaks

_SURE = 0.3  # confidence
_JOINTS = 8  # that go on elsewhere, or do not, at least
_FAR = 0.07  # of the body's size, beyond how crooked the ways are
_FAST, _STEPS = 0.9, 2.5  # of clips of few frames a second: times the steps of their fast frames
_SEVERAL, _HARDLY = 0.8, 0.05  # of what is far: in several views at once, and at least in one
_MIRRORED = list(LANDMARKS16.mirrored())


def examine_seams(names: Sequence[str], pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Frames from which on joints are elsewhere than they were going, in all views at once.

    Lines through the frames before and those after each moment are continued to it. A person's own
    meet there; where takes were put one behind the other, or frames left out, they do not. Joints
    of one view alone go over to another person or another side: each may go on as the other side's,
    and of several views the geometric mean counts.

    Args:
        names: of the views, whose cameras rest.
        pixels: joints, (F, C, 16, 2).
        confidence: (F, C, 16).
    """
    if len(pixels) < 2 * WINDOW:
        return []
    known = (confidence > _SURE) & pixels.isfinite().all(-1)
    known[1:] &= (pixels.diff(dim=0) != 0).any(-1).any(-1, keepdim=True)  # held ones show no way
    apart = torch.stack(
        [_apart(*view) for view in zip(pixels.unbind(1), known.unbind(1), strict=True)], 1
    )
    seen = apart.isfinite().sum(1) >= min(2, len(names))
    together = torch.where(seen, apart.clamp(min=_HARDLY).log().nanmean(1).exp(), torch.nan)
    least = 1.0 if len(names) == 1 else _SEVERAL
    frames = (peaks(together, least).nonzero()[:, 0] + 1).tolist()
    if not frames:
        return []
    subject, where = (names[0], "") if len(names) == 1 else ("detections", " in the views")
    what = (
        f"joints are elsewhere{where} than they were going, from frames {ranges(frames)} on (of "
        "the capture, counted from 0)"
    )
    remedy = (
        "were takes put one behind the other there, or frames left out? Capture the parts one at a "
        "time: motion is smoothed across"
    )
    return [Finding(Severity.WARNING, subject, what, remedy)]


def _apart(pixels: Tensor, known: Tensor) -> Tensor:
    """How far ways of a view (F, 16, 2) miss each other, in what is far, (F - 1,).

    NaN where few joints show it.
    """
    size = body_size(pixels, known)
    if size is None:
        return pixels.new_full((len(pixels) - 1,), torch.nan)
    off, crooked = meeting(pixels, known, _MIRRORED)
    beyond = (off - crooked).clamp(min=0)
    both = known[1:] & known[:-1]
    steps = torch.where(both, pixels.diff(dim=0).norm(dim=-1), torch.nan).nanmedian(-1).values
    fast = float(steps.nanquantile(_FAST))
    enough = beyond.isfinite().sum(-1) >= _JOINTS
    missed = torch.where(enough, beyond.nanmedian(-1).values, torch.nan)
    return missed / max(_FAR * size, _STEPS * fast)
