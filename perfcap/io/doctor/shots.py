"""Whether what is behind a person stays where it is: videos cut, and tripods are knocked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise, product

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.footage import Frames
from perfcap.io.doctor.rest import (
    CONFIDENT,
    CORNERS,
    FAR,
    about_joints,
    examine_rest,
    median_shift,
)
from perfcap.segment.registration import find_landmarks, register, shrink

_APART, _MOST = 2.0, 16  # s between frames that are compared, and of these at most
_BETWEEN = 1.0  # s that one shot takes at most to become the next
_ALIKE = 0.5  # correlation of edges; lamps that go on and off leave more
_SHORTEST = 5  # frames of a shot
_REMEDY = "parts can be captured one at a time; the longest is --frames"

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


def examine_standing(
    clip: Frames,
    names: Sequence[str],
    rate: float,
    joints2d: Array,
    confidence: Array,
    *,
    first: int = 0,
    rests: bool = False,
) -> list[Finding]:
    """Views whose cameras move, and of the others those whose background does not stay.

    Args:
        clip: as of ``examine_shots``, and so are the others.
        names: of the views.
        rate: frames a second.
        joints2d: of the person.
        confidence: of them.
        first: number of the first frame in the video.
        rests: whether it is known that no camera moves.
    """
    seen = clip, names, rate, joints2d, confidence
    moved = [] if rests else examine_rest(*seen)
    named = {finding.subject for finding in moved}
    return moved + [each for each in examine_shots(*seen, first) if each.subject not in named]


def examine_shots(
    clip: Frames,
    names: Sequence[str],
    rate: float,
    joints2d: Array,
    confidence: Array,
    first: int = 0,
) -> list[Finding]:
    """Views of cameras at rest in which the background is another one, or elsewhere, later on.

    Args:
        clip: C views.
        names: of the views, C.
        rate: frames a second.
        joints2d: of the person in pixels of the videos, (F, C, 16, 2).
        confidence: of them, (F, C, 16).
        first: number of the first frame in the video.
    """
    findings = []
    for view, name in enumerate(names):
        count = min(len(clip), len(joints2d))
        seen = _View(clip, view, joints2d[:, view], confidence[:, view] > CONFIDENT)
        cuts = _cuts(seen, count, rate)
        if not cuts:
            continue
        ends = [0, *(cut for _, cut in cuts)], [*(cut + 1 for cut, _ in cuts), count]
        start, stop = max(zip(*ends, strict=True), key=lambda shot: shot[1] - shot[0])
        where = ", ".join(str(first + cut) for _, cut in cuts)
        what = (
            f"what is behind the person is another, or elsewhere, from frame {where} on: the video "
            "cuts, or the camera was moved"
        )
        remedy = f"{_REMEDY} {first + start}:{first + stop}"
        findings.append(Finding(Severity.WARNING, name, what, remedy))
    return findings


class _View:
    """Frames of a view, and whether two of them have one background."""

    def __init__(self, clip: Frames, view: int, joints: Array, seen: NDArray[np.bool_]) -> None:
        self._clip, self._view, self._joints, self._seen = clip, view, joints, seen

    def _read(self, frame: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        image = self._clip.read_view(self._view, frame, frame + 1)[0]
        return image, about_joints(self._joints[frame, self._seen[frame]], image.shape[:2])

    def shows(self, frame: int) -> bool:
        """Whether there are corners enough."""
        return len(find_landmarks(*self._read(frame), CORNERS).corners) >= 2 * CORNERS.least

    def held_before(self, frame: int, back: int) -> bool:
        """Whether the background is where it was so many frames ago."""
        return self.held(frame, frame - back)

    def held(self, frame: int, other: int) -> bool:
        """Whether the background is where it was."""
        (image, hidden), (then, covered) = self._read(frame), self._read(other)
        landmarks = find_landmarks(image, hidden | covered, CORNERS)
        matrix = register(landmarks, then, CORNERS)
        if matrix is not None:
            return bool(median_shift(landmarks, matrix) < FAR * max(image.shape[:2]))
        if len(landmarks.corners) < CORNERS.least:
            return True  # nothing is known
        size = landmarks.gray.shape[::-1]
        away = (hidden | covered).astype(np.uint8)
        open_ = cv2.resize(away, size, interpolation=cv2.INTER_NEAREST) == 0
        edges = [_edges(each)[open_] for each in (landmarks.gray, shrink(then, landmarks.scale))]
        flat = min(float(each.std()) for each in edges) == 0
        return flat or bool(np.corrcoef(*edges)[0, 1] > _ALIKE)


def _edges(gray: NDArray[np.uint8]) -> Array:
    smooth = cv2.GaussianBlur(gray, (0, 0), 1.5).astype(np.float64)
    return np.asarray(np.hypot(cv2.Sobel(smooth, -1, 1, 0), cv2.Sobel(smooth, -1, 0, 1)))


def _cuts(view: _View, count: int, rate: float) -> list[tuple[int, int]]:
    """Last frame of a shot and first one of the next, of each change."""
    if count < 2 * _SHORTEST:
        return []
    many = min(_MOST, max(2, round(count / rate / _APART) + 1))
    anchors = np.linspace(0, count - 1, many).round().astype(int).tolist()
    found = []
    for index, (begin, end) in enumerate(pairwise(anchors)):
        if view.held(begin, end) or not (view.shows(begin) and view.shows(end)):
            continue
        if any(view.held(*pair) for pair in product(anchors[: index + 1], anchors[index + 1 :])):
            continue  # somebody went by before the camera
        last = _last(partial(view.held, begin), begin, end)
        first = end - _last(partial(view.held_before, end), 0, end - last)
        short = min(last + 1, count - first) < _SHORTEST
        if not short and 0 < first - last <= max(1, round(_BETWEEN * rate)):
            found.append((last, first))
    return found


def _last(holds: Callable[[int], bool], low: int, high: int) -> int:
    """The last number from ``low`` on, below ``high``, that holds as ``low`` does."""
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
