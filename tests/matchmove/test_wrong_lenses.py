"""Lenses, masks and directions of other kinds, which were taken for what they are not."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from staged_sightings import FOCAL, MIDDLE, RATE, filmed

from perfcap.errors import InputError
from perfcap.matchmove import (
    CornerTracks,
    Sight,
    find_bars,
    find_ground,
    find_vertical,
    find_way,
    find_zoom,
    picture_size,
)

IMAGE = np.random.default_rng(0).integers(0, 255, (90, 160, 3), dtype=np.uint8)
HIDDEN = np.zeros((90, 160), np.bool_)
LENS = (140.0, 79.5, 44.5)
UP = np.array([0.0, -1.0, 0.0])


@pytest.mark.parametrize("find", [find_way, find_zoom])
def test_lens_and_frames_are_of_the_video(find: object) -> None:
    seen = filmed(frames=12, turn=4.0)
    right = (seen.sightings, seen.frames, (FOCAL, MIDDLE, MIDDLE), RATE)
    find(*right)  # type: ignore[operator]
    for number, wrong, words in (
        (1, 5, "frames is 5"),
        (2, (35.0, MIDDLE, MIDDLE), "millimetres"),
        (2, (FOCAL, 0.5, 0.5), "principal point"),
        (2, (0.0, MIDDLE, MIDDLE), "above zero"),
        (3, 0.0, "rate"),
    ):
        given = [*right]
        given[number] = wrong
        with pytest.raises(InputError, match=words):
            find(*given)  # type: ignore[operator]


def test_the_seconds_of_a_frame_are_no_rate() -> None:
    seen = filmed(frames=12, turn=4.0)
    with pytest.warns(UserWarning, match="if a frame takes"):
        find_zoom(seen.sightings, seen.frames, (FOCAL, MIDDLE, MIDDLE), 1 / 30)


@pytest.mark.parametrize(
    ("image", "hidden"),
    [
        (IMAGE / 255, HIDDEN),
        (IMAGE, HIDDEN.T),
        (IMAGE, HIDDEN[::2, ::2]),
        (IMAGE, HIDDEN * 0.9),
        (IMAGE, HIDDEN.astype(np.uint8)),
    ],
)
def test_corners_and_edges_want_bytes_and_masks_of_them(
    image: NDArray[np.uint8], hidden: NDArray[np.bool_]
) -> None:
    with pytest.raises(InputError, match="expected"):
        CornerTracks().add(image, hidden)
    with pytest.raises(InputError, match="expected"):
        Sight(image, hidden, LENS, np.eye(3))


def test_corners_are_of_one_video() -> None:
    tracks = CornerTracks()
    tracks.add(IMAGE, HIDDEN)
    tracks.add(IMAGE, HIDDEN)
    other = np.ascontiguousarray(IMAGE.transpose(1, 0, 2))
    with pytest.raises(InputError, match="rows and columns"):
        tracks.add(other, HIDDEN.T)


def test_bars_are_of_bytes() -> None:
    with pytest.raises(InputError, match="uint8"):
        find_bars([IMAGE / 255])
    with pytest.raises(InputError, match="uint8"):
        picture_size([IMAGE / 255])


def test_sights_have_a_lens_and_a_rotation() -> None:
    sight = Sight(IMAGE, HIDDEN, LENS, np.eye(3))
    find_vertical([sight], UP)
    with pytest.raises(InputError, match="millimetres"):
        replace(sight, lens=(8.0, *LENS[1:]))
    with pytest.raises(InputError, match="mirror"):
        replace(sight, rotation=np.diag([1.0, 1, -1]))
    with pytest.raises(InputError, match="unit vector"):
        find_vertical([sight], 9.81 * UP)


def test_ground_is_sought_about_a_unit_vector_in_radians() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3))
    find_ground(points, UP, 0.1)
    with pytest.raises(InputError, match="radians"):
        find_ground(points, UP, 6.0)
    with pytest.raises(InputError, match="unit vector"):
        find_ground(points, 9.81 * UP, 0.1)
    with pytest.raises(InputError, match="points"):
        find_ground(points[:, :2], UP, 0.1)
