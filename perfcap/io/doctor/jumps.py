"""Where the joints of a view go over from one person to another."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.body_size import body_size
from perfcap.io.doctor.finding import Finding, Severity, ranges
from perfcap.io.doctor.paths import WINDOW, meeting, peaks

_HIPS = [LANDMARKS.index(name) for name in ("r_hip", "l_hip")]
_SHOULDERS = [LANDMARKS.index(name) for name in ("r_shoulder", "l_shoulder")]
_SURE = 0.3  # confidence
_FAR = 0.2  # of the body's size; the fastest dancers reach 0.15 where they land
_USUAL = 8.0  # times the usual jump of a clip: where frames are few and joints noisy
_AWAY = 1.0  # of the size: whoever is found so far from where somebody was lost


def examine_jumps(
    name: str, pixels: Tensor, confidence: Tensor, *, alone: bool = True
) -> list[Finding]:
    """Frames in which the trunk is not where it was going, nor comes from where it was.

    The paths of hips and shoulders before and after a frame are continued to the moment between,
    by straight lines through four frames each. A person's own paths meet there.

    Args:
        name: of the view, whose camera rests.
        pixels: joints, (F, 16, 2).
        confidence: (F, 16).
        alone: whether nobody else is followed, so that it helps to say who is.
    """
    size = body_size(pixels, confidence > _SURE)
    if size is None:
        return []
    frames = _jumps(pixels, confidence, size) + _returns(pixels, confidence, size)
    if not frames:
        return []
    where = ranges(sorted(set(frames)))
    what = (
        f"the joints jump from one place to another (frames {where} of the capture, counted from 0)"
    )
    choose = "--box or --person, detections of one person, or " if alone else ""
    remedy = (
        "do they go over to somebody else there, or does the video cut? give "
        f"{choose}a part with --frames"
    )
    return [Finding(Severity.WARNING, name, what, remedy)]


def _jumps(pixels: Tensor, confidence: Tensor, size: float) -> list[int]:
    """Frames before which both middles of the trunk jump."""
    if len(pixels) < 2 * WINDOW:
        return []
    # a side that is exchanged moves neither middle; a joint that is lost moves one of them
    both = [meeting(*_middle(pixels, confidence, part))[0] for part in (_HIPS, _SHOULDERS)]
    jump = torch.minimum(*both) / size
    known = jump[jump.isfinite()]
    if not len(known):
        return []
    far = max(_FAR, _USUAL * float(known.median()))
    return (peaks(jump, far).nonzero()[:, 0] + 1).tolist()


def _middle(pixels: Tensor, confidence: Tensor, part: list[int]) -> tuple[Tensor, Tensor]:
    """Middle (F, 2) of two joints, and in which frames both are sure, (F,)."""
    return pixels[:, part].mean(1), (confidence[:, part] > _SURE).all(-1)


def _returns(pixels: Tensor, confidence: Tensor, size: float) -> list[int]:
    """Frames in which somebody is found far from where somebody was lost some frames before."""
    middle, known = _middle(pixels, confidence, [*_HIPS, *_SHOULDERS])
    seen = known.nonzero()[:, 0]
    lost = seen.diff() > 1
    away = middle[seen].diff(dim=0).norm(dim=-1) > _AWAY * size
    return seen[1:][lost & away].tolist()
