"""Whether masks that somebody has are of the frames that they are given for."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.io.doctor.finding import Finding, Severity, ranges

_SURE = 0.3  # confidence of a joint
_PART, _PARTS = 10, 30  # frames, and parts that are looked at
_SHIFTS = 12  # frames, both ways
_LEAST = 2  # frames; one may be the rounding of names
_SHORTEST = 8  # frames
# of the person's height: how far joints lie outside of the mask, in the mean
_FAR = 0.004
_LEFT = 0.3  # share of it that masks of other frames may leave
_MOVED = 0.04  # of the height, by which joints move while masks stay the same

Mask = NDArray[np.bool_]
Reader = Callable[[int], "Mask | None"]
Array = NDArray[np.float64]


def examine_masks(
    name: str, read: Reader, pixels: Array, confidence: Array, first: int = 0
) -> list[Finding]:
    """Masks that are early or late in some frames, or the same while the person moves.

    Joints lie in the mask of their own frame.

    Args:
        name: of the view.
        read: the mask of a frame, (H, W); None where there is none.
        pixels: joints in the view, (F, 16, 2).
        confidence: (F, 16).
        first: number of the first frame.
    """
    height = _height(pixels, confidence)
    if not height > 0:
        return []
    shown = _Shown(read, pixels, confidence > _SURE, height)
    count = len(pixels)
    starts = np.unique(np.linspace(0, max(0, count - _PART), _starts(count)).round().astype(int))
    rows = {frame for start in starts for frame in range(start, min(count, start + _PART))}
    found = {frame: shown.off(frame) for frame in sorted(rows)}
    held = _held(shown, found)
    findings = []
    if held:
        what = f"the masks are the same in frames {ranges([first + each for each in held])}"
        remedy = "the person moves there: were gaps filled with the last mask? leave those out"
        findings.append(Finding(Severity.WARNING, f"masks of {name}", what, remedy))
    for shift, frames in _shifted(found, starts, set(held)):
        what = (
            f"look as if of {abs(shift)} or so frames {'later' if shift > 0 else 'earlier'} in "
            f"frames {ranges([first + each for each in frames])}"
        )
        remedy = "number each as the frame of the video that it was made of, from 0"
        findings.append(Finding(Severity.WARNING, f"masks of {name}", what, remedy))
    return findings


def _starts(count: int) -> int:
    """How many parts, overlapping by half in a clip that is short enough."""
    return max(1, min(_PARTS, 2 * (count // _PART)))


def _height(pixels: Array, confidence: Array) -> float:
    y = np.where(confidence > _SURE, pixels[..., 1], np.nan)
    known = (confidence > _SURE).sum(-1) > 3
    return float(np.median(np.nanmax(y[known], -1) - np.nanmin(y[known], -1))) if known.any() else 0


class _Shown:
    """Masks of a view, and how far joints lie outside of them."""

    def __init__(self, read: Reader, pixels: Array, sure: Mask, height: float) -> None:
        self.read, self.pixels, self.sure, self.height = read, pixels, sure, height
        self.prints: dict[int, bytes] = {}

    def off(self, frame: int) -> Array:
        """Mean distance from the mask of the joints at each shift, (2 S + 1,), of the height."""
        off = np.full(2 * _SHIFTS + 1, np.nan)
        mask = self.read(frame)
        if mask is None or not mask.any():
            return off
        self.prints[frame] = np.packbits(mask).tobytes()
        outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3)
        for place, shown in enumerate(range(frame - _SHIFTS, frame + _SHIFTS + 1)):
            if 0 <= shown < len(self.pixels) and self.sure[shown].sum() > 3:
                x, y = self.pixels[shown][self.sure[shown]].round().astype(int).T
                inside = (x >= 0) & (y >= 0) & (x < mask.shape[1]) & (y < mask.shape[0])
                if inside.any():
                    off[place] = outside[y[inside], x[inside]].mean() / self.height
        return off


def _held(shown: _Shown, found: dict[int, Array]) -> list[int]:
    """Frames whose masks are those of the frame before, or begin such a stretch."""
    prints = shown.prints
    same = [f for f in found if f in prints and prints.get(f - 1) == prints[f]]
    held: list[int] = []
    for run in np.split(np.array(same, int), np.flatnonzero(np.diff(same) > 1) + 1):
        if len(run) + 1 < _SHORTEST:
            continue
        whole = np.arange(run[0] - 1, run[-1] + 1)
        both = shown.sure[whole].all(0)
        way = np.linalg.norm(shown.pixels[whole] - shown.pixels[whole[0]], axis=-1)[:, both]
        if both.any() and way.mean(-1).max() > _MOVED * shown.height:
            held += whole.tolist()
    return held


def _shifted(
    found: dict[int, Array], starts: NDArray[np.int64], apart: set[int]
) -> list[tuple[int, list[int]]]:
    """By how much masks are of later frames than theirs, and which."""
    parts = [[f for f in range(s, s + _PART) if f in found and f not in apart] for s in starts]
    wrong: dict[int, set[int]] = {}
    for part in (part for part in parts if len(part) >= _SHORTEST):
        table = np.stack([found[frame] for frame in part])
        known = np.isfinite(table).sum(0) >= _SHORTEST
        left = np.array([_mean(column) for column in table.T])
        here, left = left[_SHIFTS], np.where(known, left, np.inf)
        shift = int(left.argmin()) - _SHIFTS
        inner = _LEAST <= abs(shift) < _SHIFTS  # at the end of the range anything may go on
        if here > _FAR and inner and left.min() < _LEFT * here:
            better = table[:, shift + _SHIFTS] < table[:, _SHIFTS]
            wrong.setdefault(shift, set()).update(np.array(part)[better].tolist())
    said: dict[int, set[int]] = {}
    for shift in sorted(wrong, key=lambda each: -len(wrong[each])):  # off by one is the same
        near = next((each for each in said if abs(each - shift) <= 1), shift)
        said[near] = said.get(near, set()) | wrong[shift]
    # where two people cross, masks and joints of a few frames may be exchanged
    return [(shift, sorted(f)) for shift, f in said.items() if len(f) >= _SHORTEST]


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
