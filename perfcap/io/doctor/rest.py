"""Whether cameras that are calibrated as if they stood still do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from perfcap.io.clip import FrameReader
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.segment.registration import (
    Landmarks,
    Matrix,
    RegistrationSettings,
    find_landmarks,
    register,
)

_GAPS = (0.5, 0.1)  # s between two images; the second where the first ones share too little
_PAIRS, _FEWEST = 8, 3  # pairs of images looked at, and that must say something
# of the longer side, that what is behind the person moves within a pair: 0.0004 at most in 42
# videos of cameras at rest, 0.004 and more of cameras that turn or are held in a hand
FAR = 0.002
_SHARE = 1 / 3  # of the pairs; who follows a person with a camera stops now and then
CONFIDENT = 0.3  # joints that say where the person is
MARGIN = 0.25  # about the joints, of their box
CORNERS = RegistrationSettings(side=320, tolerance=0.7)
_REMEDY = (
    "its motion becomes the person's, and the floor is lost: film from a tripod, or give R and t "
    "of every frame in camera.json"
)

Array = NDArray[np.float64]


def examine_rest(
    clip: FrameReader, names: Sequence[str], rate: float, joints2d: Array, confidence: Array
) -> list[Finding]:
    """Views in which what is behind the person moves, from pairs of images evenly spread.

    Plain walls show nothing, and neither does a person who fills the picture.

    Args:
        clip: C views.
        names: of the views, C.
        rate: frames a second.
        joints2d: of the person in pixels of the videos, (F, C, 16, 2).
        confidence: of them, (F, C, 16).
    """
    findings = []
    for view, name in enumerate(names):
        shift = background_shift(clip, view, rate, joints2d[:, view], confidence[:, view])
        if shift is None:
            continue
        what = (
            f"the camera moves, but is taken to stand still (what is behind the person shifts by "
            f"{shift:.1%} of the image within half a second)"
        )
        findings.append(Finding(Severity.WARNING, name, what, _REMEDY))
    return findings


def background_shift(
    clip: FrameReader, view: int, rate: float, joints2d: Array, confidence: Array
) -> float | None:
    """How far what is behind a person moves within half a second, of the longer side of the image.

    Args:
        clip: the frames.
        view: which of its views.
        rate: frames a second.
        joints2d: of the person in pixels of the video, (F, 16, 2).
        confidence: of them, (F, 16).

    Returns:
        None of a camera at rest, or of a background that shows nothing.
    """
    moved = _moved(clip, view, rate, joints2d, confidence > CONFIDENT)
    far = [each for each in moved if each > FAR]
    if len(moved) < _FEWEST or len(far) < max(2, _SHARE * len(moved)):
        return None
    return float(np.median(far))


def _moved(
    clip: FrameReader, view: int, rate: float, joints: Array, seen: NDArray[np.bool_]
) -> list[float]:
    """How far the background moves within each pair that shows it, of the longer side."""
    count = min(len(clip), len(joints))
    if count < 2:
        return []
    starts, gaps = _pairs(count, rate)
    shown = [start for start in starts if seen[start].any()]
    moved: dict[int, float] = {}
    for gap in gaps:
        pairs = {start: start + gap for start in shown if start not in moved}
        moved |= _moved_between(clip, view, pairs, joints, seen)
    return list(moved.values())


def rest_frames(count: int, rate: float) -> list[int]:
    """Frames of a clip of so many that are looked at, wherever the person is seen."""
    if count < 2:
        return []
    starts, gaps = _pairs(count, rate)
    return sorted({*starts, *(start + gaps[0] for start in starts)})


def _pairs(count: int, rate: float) -> tuple[list[int], list[int]]:
    """First frames of pairs, and how many frames later the second ones are, by preference."""
    gaps = [min(max(1, round(gap * rate)), count - 1) for gap in _GAPS]
    starts = np.linspace(0, count - 1 - gaps[0], min(_PAIRS, count - gaps[0])).round().astype(int)
    return starts.tolist(), gaps


def _moved_between(
    clip: FrameReader, view: int, pairs: dict[int, int], joints: Array, seen: NDArray[np.bool_]
) -> dict[int, float]:
    """The same for pairs of frames, by the first of each; none of pairs that show nothing.

    Frames are read in their order: to go back in a video is to decode it from its last key frame.
    """
    moved: dict[int, float] = {}
    known: dict[int, Landmarks] = {}
    for frame in sorted({*pairs, *pairs.values()}):
        image = clip.read_view(view, frame, frame + 1)[0]
        for start in (start for start, stop in pairs.items() if stop == frame):
            matrix = register(known[start], image, CORNERS)
            if matrix is not None:
                moved[start] = median_shift(known[start], matrix) / max(image.shape[:2])
        if frame in pairs:
            hidden = about_joints(joints[frame, seen[frame]], image.shape[:2])
            known[frame] = find_landmarks(image, hidden, CORNERS)
    return moved


def about_joints(joints: Array, size: tuple[int, ...], share: float = MARGIN) -> NDArray[np.bool_]:
    """The box about joints (n, 2) in an image of (height, width), and a margin; none of none.

    The margin is a share of the box's longer side.
    """
    hidden = np.zeros(size, np.bool_)
    if len(joints):
        low, high = joints.min(0), joints.max(0)
        margin = share * float((high - low).max())
        left, top = np.maximum(low - margin, 0).astype(int)
        right, bottom = np.maximum(high + margin + 1, 0).astype(int)
        hidden[top:bottom, left:right] = True
    return hidden


def median_shift(landmarks: Landmarks, matrix: Matrix) -> float:
    """How far a homography of full pixels moves the corners in the median, pixels."""
    corners = landmarks.corners.reshape(-1, 2) / landmarks.scale
    there = np.pad(corners, ((0, 0), (0, 1)), constant_values=1.0) @ matrix.T
    apart = np.linalg.norm(there[:, :2] / there[:, 2:] - corners, axis=-1)
    return float(np.median(apart))
