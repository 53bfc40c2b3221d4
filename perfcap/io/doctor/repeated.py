"""Joints that are those of an earlier frame to the last digit, which no detector finds."""

from __future__ import annotations

from itertools import groupby

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.finding import Finding, Severity, of_view, ranges

_NAMED = 3  # numbers of frames in words
_MOST = 4  # joints in words
_SOME = 4  # joints that tell a repeated frame
_FEWEST, _SHARE = 3, 0.05  # frames that repeat the one before, and share of them
# Frames that hold one joint, and share of the other numbers that are there once: joints on whole
# pixels, or on those of a heat map, stay where they are now and then
_HOLDS, _UNIQUE = 5, 0.9
_OFTEN = 0.05  # of the frames that show a joint, in which it lies at the one place
_COLLAPSED = 8  # joints at one place
_LONG = 8  # frames that all repeat one: the person moves on, and networks look more often


def examine_repeated(name: str, view: int, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Frames whose joints are those of the frame before, or of others that follow each other.

    Args:
        name: of the view.
        view: its number.
        pixels: joints, (F, 16, 2), or where there are none 3D ones, (F, 16, 3).
        confidence: (F, 16).
    """
    held = of_view(view, examine_held(name, pixels, confidence, found=True), partly=True)
    return [
        *(held or _held_joints(name, pixels, confidence) or _filled(name, pixels, confidence)),
        *_again(name, view, pixels, confidence),
        *_collapsed(name, view, pixels, confidence),
    ]


def examine_held(
    name: str, pixels: Tensor, confidence: Tensor, joints: str = "joints", *, found: bool = False
) -> list[Finding]:
    """Frames whose joints are those of the frame before; those of long stretches are wrong.

    Args:
        name: of the view.
        pixels: joints, (F, 16, 2), or 3D ones, (F, 16, 3).
        confidence: (F, 16).
        joints: what they are called.
        found: whether a detector found them: a motion may stand quite still for a while.
    """
    seen = confidence > 0
    both = (seen[1:] & seen[:-1]).sum(-1) >= _SOME
    same = ((pixels[1:] == pixels[:-1]).all(-1) | ~seen[1:]).all(-1) & both
    repeated, pairs, frames = int(same.sum()), int(both.sum()), _long_stretches(same)
    if repeated < max(_FEWEST, _SHARE * pairs) and not (found and frames):
        return []
    what = f"{repeated} of {pairs} frames repeat the {joints} of the frame before to the last digit"
    where = f", frames {ranges(frames)} (counted from 0) one after the other" if frames else ""
    remedy = (
        "no detector does; if it ran on some frames alone, leave the others out, and give video "
        "and detections the same frame rate"
    )
    return [Finding(Severity.WARNING, name, what + where, remedy, frames)]


def _long_stretches(same: Tensor) -> tuple[int, ...]:
    """Frames of the stretches in which each is (F - 1,) as the one before, if they are long."""
    frames: list[int] = []
    for held, part in groupby(range(1, len(same) + 1), key=lambda frame: bool(same[frame - 1])):
        stretch = list(part)
        frames += stretch if held and len(stretch) >= _LONG else []
    return tuple(frames)


def _held_joints(name: str, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Single joints that stay on the same pixel to the last digit while others move."""
    seen = confidence > 0
    same = (pixels[1:] == pixels[:-1]).all(-1) & seen[1:] & seen[:-1]
    same &= (seen[1:] & seen[:-1] & ~same).sum(-1, keepdim=True) >= _SOME
    found = [joint for joint in range(same.shape[1]) if int(same[:, joint].sum()) >= _HOLDS]
    others = pixels[1:][seen[1:] & ~same]
    if not found or len(others) == 0:
        return []
    if min(len(set(axis)) for axis in others.mT.tolist()) < _UNIQUE * len(others):
        return []
    joints = ", ".join(f"{LANDMARKS[j]} ({int(same[:, j].sum())})" for j in found)
    what = f"joints stay where they were in the frame before to the last digit: {joints} frames"
    remedy = (
        "no detector does; were gaps filled with the last place? Give confidence 0 to what is not "
        "detected"
    )
    return [Finding(Severity.WARNING, name, what, remedy)]


def _filled(name: str, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Single joints that come back to one place to the last digit, as the mean of all frames."""
    seen = (confidence > 0) & pixels.isfinite().all(-1)
    found, others = [], []
    for joint, known in enumerate(seen.mT):
        places, counts = torch.unique(pixels[known, joint], dim=0, return_counts=True)
        most = int(counts.max()) if len(counts) else 0
        filled = most >= max(_HOLDS, _OFTEN * int(known.sum()))
        found += [f"{LANDMARKS[joint]} ({most})"] if filled else []
        others.append(pixels[known, joint] if not filled else places[counts < most])
    rest = torch.cat(others)
    if not found or min(len(set(axis)) for axis in rest.mT.tolist()) < _UNIQUE * len(rest):
        return []
    named = ", ".join(found[:_MOST]) + (f" and {len(found) - _MOST} more" * (len(found) > _MOST))
    what = f"joints lie at one place to the last digit again and again: {named} frames"
    remedy = (
        "no detector finds them so; were gaps filled with the mean of a clip? Give confidence 0 to "
        "what is not detected"
    )
    return [Finding(Severity.WARNING, name, what, remedy)]


def _collapsed(name: str, view: int, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Frames in which many joints lie at one place to the last digit."""
    seen = confidence > 0
    alike = (pixels.unsqueeze(-2) == pixels.unsqueeze(-3)).all(-1)
    together = (alike & seen.unsqueeze(-1) & seen.unsqueeze(-2)).sum(-1).amax(-1)
    frames = tuple((together >= _COLLAPSED).nonzero().flatten().tolist())
    if not frames:
        return []
    what = (
        f"{int(together.max())} joints with confidence lie at one place to the last digit in "
        f"frames {ranges(frames)} (of the capture, counted from 0)"
    )
    remedy = "no person looks so; give confidence 0 to what is not detected"
    return [Finding(Severity.WARNING, name, what, remedy, frames, (view,))]


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
