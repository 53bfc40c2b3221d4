"""Stills of a video: spread over what it shows, sharp; the person in their middle."""

import cv2
import numpy as np
import pytest

from perfcap.metrics import mask_overlap
from perfcap.segment.central_person import central_person
from perfcap.segment.still_frames import Stills, blurred, choose_stills, look_over

WALL = np.random.default_rng(1).uniform(0, 255, (40, 120, 3)).astype(np.float32)
WALL = cv2.resize(WALL, (960, 240), interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
CLOTH = cv2.resize(WALL[:60, 300:340], (60, 200), interpolation=cv2.INTER_CUBIC)


def seen(shift: float) -> np.ndarray:
    """A person in patterned clothes before a wall that passes by."""
    picture = WALL[:, int(shift) : int(shift) + 180].copy()
    picture[20:220, 60:120] = CLOTH
    return picture


def test_frames_are_spread_over_motion_not_time() -> None:
    travel = np.concatenate([np.linspace(0, 1, 80), np.full(40, 1.0), np.linspace(1, 3, 40)])
    stills = Stills(np.ones(160), travel)
    places = travel[choose_stills(stills, 12)]
    assert len(places) == 12 and np.abs(np.diff(places) - 0.25).max() < 0.15


def test_the_sharpest_of_each_stretch_is_taken() -> None:
    sharpness = np.ones(100)
    sharpness[7::10] = 2.0
    stills = Stills(sharpness, np.arange(100.0))
    assert choose_stills(stills, 10) == list(range(7, 100, 10))
    sharpness[17] = 0.1
    sharpness[11:20] = 0.1
    assert len(blurred(stills, [7, 13, 27])) == 1


def test_a_still_video_gives_one_frame_and_a_short_one_all() -> None:
    assert choose_stills(Stills(np.array([1.0, 3.0, 2.0]), np.zeros(3)), 60) == [1]
    assert choose_stills(Stills(np.ones(4), np.arange(4.0)), 60) == [0, 1, 2, 3]


def test_smears_are_less_sharp_and_motion_adds_up() -> None:
    frames = [seen(4 * k) for k in range(6)]
    frames[3] = cv2.blur(frames[3], (7, 7))
    stills = look_over(frames)
    assert stills.sharpness.argmin() == 3
    assert stills.sharpness[3] < 0.5 * np.median(stills.sharpness)
    assert (np.diff(stills.travel) >= 0).all()


@pytest.mark.parametrize("turntable", [False, True])
def test_whoever_moves_otherwise_is_the_person(turntable: bool) -> None:
    truth = np.zeros((240, 180), bool)
    truth[20:220, 60:120] = True

    def view(shift: float) -> np.ndarray:
        if not turntable:
            return seen(300 + shift)
        picture = WALL[:, 300:480].copy()
        picture[20:220, 60:120] = np.roll(CLOTH, int(shift), 1)
        return picture

    found = central_person(view(0), [view(-4), view(4)])
    assert mask_overlap(found, truth).iou > 0.85


@pytest.mark.long
def test_a_flat_place_that_passes_by_leaves_the_colours() -> None:
    """Nobody moves otherwise than the surroundings do: all would be place."""
    passing = [WALL[:, 300 + shift : 480 + shift].copy() for shift in (-4, 0, 4)]
    found = central_person(passing[1], [passing[0], passing[2]])
    np.testing.assert_array_equal(found, central_person(passing[1]))
