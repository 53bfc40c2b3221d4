"""Whether what is behind a person stays where it is: videos cut, and tripods are knocked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.io.clip import FrameReader
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.rest import (
    CONFIDENT,
    CORNERS,
    FAR,
    MARGIN,
    about_joints,
    examine_rest,
    median_shift,
)
from perfcap.segment.registration import Landmarks, find_landmarks, register

_APART, _MOST = 2.0, 16  # s between frames that are compared, and of these at most
_BETWEEN = 1.0  # s that one shot takes at most to become the next
_ALIKE = 0.5  # correlation of edges; lamps that go on and off leave more
_TILES, _STRONG = 8, 0.2  # along each side, and of the deviation of edges, to be looked at
_SAME, _STAYS = 0.8, 0.2  # correlation of a tile that stays, and share of such
_SHORTEST = 5  # frames of a shot
_GOES = (2, 4, 8)  # frames within which a camera that is picked up is seen to move
# margin about the joints of each of several people, of their box: with that of one person alone two
# who fill the image leave so little of the background that half of the cuts are missed
_CROWDED = 0.1
_REMEDY = "parts can be captured one at a time; the longest is --frames"

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


def examine_standing(
    clip: FrameReader,
    names: Sequence[str],
    rate: float,
    joints2d: Array,
    confidence: Array,
    *,
    first: int = 0,
    rests: bool = False,
    everybody: tuple[Array, Array] | None = None,
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
        everybody: joints (P, F, C, 16, 2) and confidence (P, F, C, 16) of all people, where there
            are more than this one: who walks past is no part of the background.
    """
    moved = [] if rests else examine_rest(clip, names, rate, joints2d, confidence)
    named = {finding.subject for finding in moved}
    seen = everybody or (joints2d, confidence)
    shots = examine_shots(clip, names, rate, *seen, first)
    return moved + [each for each in shots if each.subject not in named]


def examine_shots(
    clip: FrameReader,
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
        joints2d: of the person, or of everybody, in pixels of the videos, (*P, F, C, 16, 2).
        confidence: of them, (*P, F, C, 16).
        first: number of the first frame in the video.
    """
    findings = []
    for view, name in enumerate(names):
        seen = joints2d[..., view, :, :], confidence[..., view, :]
        changes = background_changes(clip, view, rate, *seen)
        if not changes:
            continue
        ends = [[0, *(c.after for c in changes)], [*(c.before + 1 for c in changes), len(clip)]]
        start, stop = max(zip(*ends, strict=True), key=lambda shot: shot[1] - shot[0])
        remedy = f"{_REMEDY} {first + start}:{first + stop}"
        cuts = [str(first + each.after) for each in changes if not each.slow]
        if cuts:
            what = (
                "what is behind the person is another, or elsewhere, from frame "
                f"{', '.join(cuts)} on: the video cuts, or the camera was moved"
            )
            findings.append(Finding(Severity.WARNING, name, what, remedy))
        slow = [f"{first + c.before} to {first + c.after}" for c in changes if c.slow]
        if slow:
            what = f"the camera moves in frames {', '.join(slow)}, and is taken to stand still"
            findings.append(Finding(Severity.WARNING, name, what, remedy))
    return findings


@dataclass(frozen=True)
class Change:
    """Of the background.

    Attributes:
        before: last frame of what was there.
        after: first frame of what is there then.
        slow: whether a camera moves between, or else the video cuts.
    """

    before: int
    after: int
    slow: bool


def background_changes(
    clip: FrameReader, view: int, rate: float, joints2d: Array, confidence: Array
) -> list[Change]:
    """Where the background of a view becomes another, or moves and then rests again.

    Args:
        clip: the frames.
        view: which of its views.
        rate: frames a second.
        joints2d: of the person, or of everybody, in pixels of the video, (*P, F, 16, 2).
        confidence: of them, (*P, F, 16).
    """
    joints2d = joints2d.reshape(-1, *joints2d.shape[-3:])
    confidence = confidence.reshape(-1, *confidence.shape[-2:])
    count = min(len(clip), joints2d.shape[1])
    if count < 2 * _SHORTEST:
        return []
    seen = _View(clip, view, joints2d, confidence > CONFIDENT, count)
    anchors = anchor_frames(count, rate)
    lost = [not seen.held(*pair) for pair in pairwise(anchors)]
    longest = max(1, round(_BETWEEN * rate))
    found: list[Change] = []
    for start, stop in _runs(lost):
        each = [_change(seen, anchors, k, k + 1, longest) for k in range(start, stop)]
        if not any(each):
            each = [_change(seen, anchors, start, stop, longest)]
        found += [change for change in each if change is not None]
    return found


def anchor_frames(count: int, rate: float) -> list[int]:
    """Frames of a clip of so many whose backgrounds are compared first."""
    many = min(_MOST, max(2, round(count / rate / _APART) + 1))
    anchors: list[int] = np.linspace(0, count - 1, many).round().astype(int).tolist()
    return anchors


def _runs(flags: Sequence[bool]) -> list[tuple[int, int]]:
    """First and behind the last of each run of what is True."""
    edges = np.flatnonzero(np.diff([False, *flags, False])).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


class _View:
    """Frames of a view, and whether two of them have one background.

    Joints are (P, F, 16, 2) of everybody, and so is whether they are seen.
    """

    def __init__(
        self, clip: FrameReader, view: int, joints: Array, seen: NDArray[np.bool_], count: int
    ) -> None:
        self._clip, self._view, self._joints, self._seen = clip, view, joints, seen
        self._count = count
        self._known: dict[int, tuple[NDArray[np.uint8], NDArray[np.bool_]]] = {}

    def _read(self, frame: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """A frame, shrunk, and where people may be."""
        if frame not in self._known:
            image = self._clip.read_view(self._view, frame, frame + 1)[0]
            scale = min(1.0, CORNERS.side / max(image.shape[:2]))
            small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            margin = MARGIN if len(self._joints) == 1 else _CROWDED
            hidden = np.zeros(small.shape[:2], np.bool_)
            for joints, seen in zip(self._joints[:, frame], self._seen[:, frame], strict=True):
                hidden |= about_joints(scale * joints[seen], small.shape[:2], margin)
            self._known[frame] = np.asarray(small), hidden
        return self._known[frame]

    def has(self, frame: int) -> bool:
        """Whether there is such a frame."""
        return 0 <= frame < self._count

    def rests(self, frame: int, step: int) -> bool:
        """Whether there are corners enough, and the background stays for some frames that way."""
        if len(find_landmarks(*self._read(frame), CORNERS).corners) < 2 * CORNERS.least:
            return False
        there = frame + step if self.has(frame + step) else frame - step  # at an end
        return self.held(frame, there)

    def held_before(self, frame: int, back: int) -> bool:
        """Whether the background is where it was so many frames ago."""
        return self.held(frame, frame - back)

    def moved(self, frame: int, other: int) -> bool:
        """Whether the background is seen elsewhere."""
        _, shift = self._shift(frame, other)
        return shift is not None and shift >= FAR

    def _shift(self, frame: int, other: int) -> tuple[Landmarks, float | None]:
        """Corners, and how far they move, of the longer side; None where they are not found."""
        (image, hidden), (then, covered) = self._read(frame), self._read(other)
        landmarks = find_landmarks(image, hidden | covered, CORNERS)
        matrix = register(landmarks, then, CORNERS)
        if matrix is None:
            return landmarks, None
        return landmarks, median_shift(landmarks, matrix) / max(image.shape[:2])

    def held(self, frame: int, other: int) -> bool:
        """Whether the background is where it was."""
        landmarks, shift = self._shift(frame, other)
        if shift is not None:
            return shift < FAR
        if len(landmarks.corners) < CORNERS.least:
            return True  # nothing is known
        (image, hidden), (then, covered) = self._read(frame), self._read(other)
        shown = ~(hidden | covered)
        edges = [_edges(each) for each in (image, then)]
        flat = min(float(each[shown].std()) for each in edges) == 0
        whole = flat or bool(np.corrcoef(edges[0][shown], edges[1][shown])[0, 1] > _ALIKE)
        return whole or _kept(edges[0], edges[1], shown) >= _STAYS


def _edges(image: NDArray[np.uint8]) -> Array:
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    smooth = cv2.GaussianBlur(gray, (0, 0), 1.5).astype(np.float64)
    return np.asarray(np.hypot(cv2.Sobel(smooth, -1, 1, 0), cv2.Sobel(smooth, -1, 0, 1)))


def _kept(edges: Array, others: Array, shown: NDArray[np.bool_]) -> float:
    """Share of the tiles with edges whose edges stay: who walks past changes some of them alone.

    Args:
        edges: of a frame, (H, W).
        others: of another frame, (H, W).
        shown: where neither shows the person, (H, W).
    """
    same = []
    strong = _STRONG * float(edges[shown].std())
    height, width = (-(-side // _TILES) for side in shown.shape)
    for top, left in product(range(0, shown.shape[0], height), range(0, shown.shape[1], width)):
        tile = slice(top, top + height), slice(left, left + width)
        here = shown[tile]
        one, other = edges[tile][here], others[tile][here]
        if 2 * here.sum() >= here.size and one.std() > strong:
            alike = other.std() > 0 and np.corrcoef(one, other)[0, 1] > _SAME
            same.append(bool(alike))
    return float(np.mean(same)) if len(same) >= _TILES else 0.0


def _change(view: _View, anchors: list[int], index: int, stop: int, longest: int) -> Change | None:
    """What happens between two anchors, of which the background rests at one at least.

    At the other it may move where the clip begins or ends, as of a phone that is picked up.
    """
    begin, end = anchors[index], anchors[stop]
    still = view.rests(begin, -_SHORTEST + 1), view.rests(end, _SHORTEST - 1)
    if not any(still) or not (still[0] or index == 0) or not (still[1] or stop == len(anchors) - 1):
        return None
    if any(view.held(*pair) for pair in product(anchors[: index + 1], anchors[stop:])):
        return None  # somebody went by before the camera
    last = _last(partial(view.held, begin), begin, end) if still[0] else begin
    first = end - (_last(partial(view.held_before, end), 0, end - last) if still[1] else 0)
    if not all(still):
        from_, way = (last, 1) if still[0] else (first, -1)
        there = [from_ + way * each for each in _GOES]
        moved = any(view.moved(from_, each) for each in there if view.has(each))
        return Change(last, first, slow=True) if moved else None
    near = max(begin, last - _SHORTEST), min(end, first + _SHORTEST)
    if view.held(*near):  # what creeps is no cut
        return None
    return Change(last, first, first - last > longest)


def _last(holds: Callable[[int], bool], low: int, high: int) -> int:
    """The last number from ``low`` on, below ``high``, that holds as ``low`` does."""
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
