"""Whether masks that somebody has are of the frames that they are given for."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.extent import end_to_end
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
_REACH = 5  # frames before and after one, within which the person moves
_OFTEN = 0.3  # share of masks that repeat; of a video taken from 25 to 30 frames a second, 0.17

_FROM_ONE = "; if their numbers begin with 1, each is a frame late: begin with 0"

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
    elif repeated := _repeated(shown, found):
        what = f"{repeated:.0%} of the masks are those of the frame before, while the person moves"
        remedy = "were they made of one frame in several? give those alone, or one of every frame"
        return [Finding(Severity.WARNING, f"masks of {name}", what, remedy)]
    for shift, frames in _shifted(found, starts, set(held)):
        what = (
            f"look as if of {abs(shift)} or so frames {'later' if shift > 0 else 'earlier'} in "
            f"frames {ranges([first + each for each in frames])}"
        )
        remedy = "number each as the frame of the video that it was made of, from 0"
        findings.append(Finding(Severity.WARNING, f"masks of {name}", what, remedy))
    return findings


def partly_masked(name: str, given: Collection[int], there: Collection[int]) -> Iterator[str]:
    """A sentence about a view of which some frames alone have masks.

    Args:
        name: of the view.
        given: numbers of the frames that have one, increasing.
        there: of all frames that have an image.
    """
    if not given or len(given) == len(there):
        return
    from_one = 0 in there and set(given) == set(there) - {0}
    yield (
        f"masks of {name}: are given for {len(given)} of {len(there)} frames, {min(given)} to "
        f"{max(given)} (counted from 0); those of the others are found in the images"
        f"{_FROM_ONE if from_one else ''}"
    )


def _starts(count: int) -> int:
    """How many parts, overlapping by half in a clip that is short enough."""
    return max(1, min(_PARTS, 2 * (count // _PART)))


def _height(pixels: Array, confidence: Array) -> float:
    seen = torch.from_numpy(confidence > _SURE)
    known = seen.sum(-1) > 3
    sizes = end_to_end(torch.from_numpy(pixels), seen)[known].numpy()
    return float(np.median(sizes)) if len(sizes) else 0.0


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

    def repeats(self, frame: int) -> bool:
        """Whether a mask is that of the frame before, to the pixel."""
        return frame in self.prints and self.prints.get(frame - 1) == self.prints[frame]

    def moves(self, start: int, stop: int) -> bool:
        """Whether joints leave, within some frames, the places where they were in the first."""
        pixels, both = self.pixels[start:stop], self.sure[start:stop].all(0)
        way = np.linalg.norm(pixels - pixels[0], axis=-1)[:, both]
        return bool(both.any() and way.mean(-1).max() > _MOVED * self.height)


def _held(shown: _Shown, found: dict[int, Array]) -> list[int]:
    """Frames whose masks are those of the frame before, or begin such a stretch."""
    same = [f for f in found if shown.repeats(f)]
    held: list[int] = []
    for run in np.split(np.array(same, int), np.flatnonzero(np.diff(same) > 1) + 1):
        if len(run) + 1 < _SHORTEST:
            continue
        if shown.moves(run[0] - 1, run[-1] + 1):
            held += range(run[0] - 1, run[-1] + 1)
    return held


def _repeated(shown: _Shown, found: dict[int, Array]) -> float:
    """Share of masks that repeat the one before where the person moves and joints differ, or 0.

    Masks of one frame in several, each given for those after it as well, stay for a few frames,
    in which nobody moves far.
    """
    moving = [f for f in found if f in shown.prints and f - 1 in shown.prints]
    moving = [f for f in moving if shown.moves(max(f - _REACH, 0), f + _REACH)]
    same = [
        f for f in moving if shown.repeats(f) and (shown.pixels[f] != shown.pixels[f - 1]).any()
    ]
    share = len(same) / max(len(moving), 1)
    return share if len(same) >= _SHORTEST and share > _OFTEN else 0.0


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
