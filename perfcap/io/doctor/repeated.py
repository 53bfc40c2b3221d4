"""Joints that are those of an earlier frame to the last digit, which no detector finds."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity, ranges

_NAMED = 3  # numbers of frames in words
_SOME = 4  # joints that tell a repeated frame
_FEWEST, _SHARE = 3, 0.05  # frames that repeat the one before, and share of them


def examine_repeated(name: str, view: int, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Frames whose joints are those of the frame before, or of others that follow each other.

    Args:
        name: of the view.
        view: its number.
        pixels: joints, (F, 16, 2).
        confidence: (F, 16).
    """
    return [*examine_held(name, pixels, confidence), *_again(name, view, pixels, confidence)]


def examine_held(
    name: str, pixels: Tensor, confidence: Tensor, joints: str = "joints"
) -> list[Finding]:
    """Frames whose joints are those of the frame before.

    Args:
        name: of the view.
        pixels: joints, (F, 16, 2), or 3D ones, (F, 16, 3).
        confidence: (F, 16).
        joints: what they are called.
    """
    seen = confidence > 0
    both = (seen[1:] & seen[:-1]).sum(-1) >= _SOME
    same = ((pixels[1:] == pixels[:-1]).all(-1) | ~seen[1:]).all(-1) & both
    repeated, pairs = int(same.sum()), int(both.sum())
    if repeated < _FEWEST or repeated < _SHARE * pairs:
        return []
    what = f"{repeated} of {pairs} frames repeat the {joints} of the frame before to the last digit"
    remedy = (
        "no detector does; if it ran on some frames alone, leave the others out, and give video "
        "and detections the same frame rate"
    )
    return [Finding(Severity.WARNING, name, what, remedy)]


def _again(name: str, view: int, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Joints of a stretch of frames that were there some frames before."""
    late = _late(pixels, confidence)
    # one who stands still may be found on the same pixels once
    frames = [
        frame
        for frame, by in enumerate(late)
        if by > 1 and by in (*late[max(0, frame - 1) : frame], *late[frame + 1 : frame + 2])
    ]
    if not frames:
        return []
    by = ", ".join(map(str, sorted({late[frame] for frame in frames})[:_NAMED]))
    what = (
        f"the joints of frames {ranges(frames)} (of the capture, counted from 0) are those of "
        f"{by} frames before to the last digit"
    )
    remedy = (
        "no detector does; were frames put in, so that all that follow are late? give joints of "
        "the video's own frames"
    )
    return [Finding(Severity.WARNING, name, what, remedy, tuple(frames), (view,))]


def _late(pixels: Tensor, confidence: Tensor) -> list[int]:
    """How many frames before each one joints (F, 16, 2) were last the same; 0 of never."""
    seen = confidence > 0
    known = torch.where(seen[..., None], pixels, torch.nan).detach().cpu().numpy()
    enough = (seen.sum(-1) >= _SOME).tolist()
    last: dict[bytes, int] = {}
    late = []
    for frame, joints in enumerate(known):
        key = joints.tobytes()
        late.append(frame - last[key] if enough[frame] and key in last else 0)
        last[key] = frame
    return late
