"""Masks of other frames, and masks that stay while the person moves, are named; sound ones not."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from takes import make_take

from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.masks import examine_masks

FRAMES, SIDE, FIRST = 60, 300, 100
FROM = 40
LINKS = [(0, 1), (1, 2), (2, 3), (3, 4), (1, 5), (5, 6), (6, 7), (1, 8), (8, 9), (9, 10), (10, 11)]
LINKS += [(1, 12), (12, 13), (13, 14), (14, 15), (8, 12)]


def walker() -> NDArray[np.float64]:
    """Joints (F, 16, 2) of somebody who walks across a small image."""
    seen = make_take(FRAMES, turns=0.2).detections.joints2d[:, 0].numpy()
    low, high = seen.min((0, 1)), seen.max((0, 1))
    placed = 160 * (seen - low) / (high - low).max() + 20
    return placed + np.linspace(0, 90, FRAMES)[:, None, None] * np.array([1.0, 0.0])


def drawn(joints: NDArray[np.float64]) -> NDArray[np.bool_]:
    image = np.zeros((SIDE, SIDE), np.uint8)
    for first, last in LINKS:
        ends = [tuple(int(value) for value in joints[end].round()) for end in (first, last)]
        cv2.line(image, ends[0], ends[1], 1, 9)
    return image > 0


def found(frame_of: Callable[[int], int], repeated: bool = False) -> list[Finding]:
    """Of masks that show other frames than their own, or of a video that repeats one in six."""
    joints = walker()
    joints = joints[[frame - frame // 6 for frame in range(FRAMES)]] if repeated else joints
    noise = np.random.default_rng(0).normal(0, 1.0, joints.shape)

    def read(frame: int) -> NDArray[np.bool_] | None:
        return drawn(joints[frame_of(frame)])

    confidence = np.full(joints.shape[:2], 0.9)
    return examine_masks("cam1", read, joints + noise, confidence, first=FIRST)


def test_sound_masks_are_quiet() -> None:
    assert found(lambda frame: frame) == []
    assert found(lambda frame: max(frame - 1, 0)) == []  # the rounding of a name


@pytest.mark.parametrize("late", [5, -5])
def test_masks_of_other_frames_from_some_frame_on(late: int) -> None:
    (finding,) = found(
        lambda frame: frame if frame < FROM else min(max(frame - late, 0), FRAMES - 1)
    )
    words = "earlier" if late > 0 else "later"
    assert finding.subject == "masks of cam1" and finding.severity is Severity.WARNING
    assert f"or so frames {words} in frames " in finding.what
    assert abs(int(finding.what.split("as if of ")[1].split()[0]) - 5) <= 1
    first = int(finding.what.split("in frames ")[1].split("-")[0])
    assert abs(first - FIRST - FROM) <= 2


def test_masks_that_are_repeated() -> None:
    (finding,) = found(lambda frame: min(frame, FROM))
    assert f"the same in frames {FIRST + FROM}-{FIRST + FRAMES - 1}" in finding.what


@pytest.mark.parametrize("every", [2, 3, 5, 7])
def test_masks_of_one_frame_in_several(every: int) -> None:
    (finding,) = found(lambda frame: frame // every * every)
    share = (every - 1) / every
    assert "are those of the frame before" in finding.what
    assert abs(int(finding.what.split("%")[0]) - 100 * share) < 6


def test_masks_of_a_video_that_repeats_one_frame_in_six_are_quiet() -> None:
    assert found(lambda frame: frame, repeated=True) == []


def test_nobody_and_no_masks_say_nothing() -> None:
    joints = walker()
    hidden = np.zeros(joints.shape[:2])
    assert examine_masks("cam1", lambda frame: None, joints, hidden) == []
    assert examine_masks("cam1", lambda frame: None, joints, hidden + 0.9) == []
