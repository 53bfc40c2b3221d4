"""Interlaced videos: the even lines of each frame are of one moment, the odd ones of another."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.io.clip import FrameReader
from perfcap.io.doctor.finding import Finding, Severity

_LOOKS = 6  # pairs of frames that follow each other, evenly spread
_COLUMNS = 4  # every so many are looked at
_MOVES, _STANDS_OUT = 20, 15  # grey levels of 255: by which pixels change, and lines differ
_FEWEST = 500  # pixels that move
# Of pixels that move, those on lines that stand out of both beside them, which are alike: 0.05 at
# most in recordings, 0.35 and more where two moments share a frame. Noise lets as many columns do
# so, which count against
_SHARE = 0.15


def examine_fields(clip: FrameReader, names: Sequence[str]) -> list[Finding]:
    """Views whose frames show two moments each, where something moves.

    Args:
        clip: C views.
        names: of the views, C.
    """
    findings = []
    for view, name in enumerate(names):
        combed = moving = 0
        for frame in field_frames(len(clip))[::2]:
            before, now = (_gray(clip, view, each) for each in (frame, frame + 1))
            moves = np.abs(now - before)[1:-1, 1:-1:_COLUMNS] > _MOVES
            lines, columns = _combs(now)[:, 1:-1:_COLUMNS], _combs(now.T)[::_COLUMNS].T[1:-1]
            combed += int((lines & moves).sum()) - int((columns & moves).sum())
            moving += int(moves.sum())
        if moving < _FEWEST or combed < _SHARE * moving:
            continue
        what = (
            f"the video is interlaced: in {combed / moving:.0%} of what moves, every other line is "
            "of another moment, so that edges are combs"
        )
        remedy = "make whole frames of it first (ffmpeg -i IN -vf bwdif=send_frame OUT)"
        findings.append(Finding(Severity.WARNING, name, what, remedy))
    return findings


def field_frames(count: int) -> list[int]:
    """Frames of a clip of so many that are looked at, pairs one after the other."""
    if count < 2:
        return []
    first = np.unique(np.linspace(0, count - 2, _LOOKS).round().astype(int))
    pairs: list[int] = np.stack((first, first + 1), 1).ravel().tolist()
    return pairs


def _gray(clip: FrameReader, view: int, frame: int) -> NDArray[np.int16]:
    image = np.ascontiguousarray(clip.read_view(view, frame, frame + 1)[0])
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.int16)


def _combs(lines: NDArray[np.int16]) -> NDArray[np.bool_]:
    """Where a line is lighter, or darker, than both beside it, which are alike, (H - 2, W)."""
    above, line, below = (lines[k : len(lines) - 2 + k].astype(np.int32) for k in range(3))
    out = (line - above) * (line - below) > _STANDS_OUT**2
    combs: NDArray[np.bool_] = out & (np.abs(above - below) < _STANDS_OUT)
    return combs
