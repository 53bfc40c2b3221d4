"""Bars beside a picture, whose edges stand still however the camera moves."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from perfcap.matchmove import find_bars, picture_size

HEIGHT, WIDTH = 100, 200


def pictures(level: int = 0) -> list[NDArray[np.uint8]]:
    """Noise between bars of one level, 50 px wide, that are a little noisy as well."""
    draw = np.random.default_rng(3)
    images = draw.integers(level, level + 10, (4, HEIGHT, WIDTH, 3), dtype=np.uint8)
    images[:, :, 50:150] = draw.integers(0, 255, (4, HEIGHT, 100, 3), dtype=np.uint8)
    return list(images)


@pytest.mark.parametrize("level", [0, 240])
def test_bars_and_their_edges(level: int) -> None:
    expected = np.ones(WIDTH, np.bool_)
    expected[54:146] = False
    images = pictures(level)
    assert (find_bars(images) == expected).all()
    turned = [np.rot90(image) for image in images]
    assert (find_bars(turned) == expected[:, None]).all()


def test_pictures_without_bars() -> None:
    whole = [image[:, 50:150] for image in pictures()]
    assert not find_bars(whole).any()
    assert not find_bars([np.zeros((HEIGHT, WIDTH, 3), np.uint8)]).any()
    one = [image[:, 50:] for image in pictures()]
    assert find_bars(one)[0].tolist() == [False] * 97 + [True] * 53


def test_the_size_of_a_picture_between_bars() -> None:
    assert picture_size(pictures()) == (HEIGHT, 100)
    assert picture_size([np.rot90(image) for image in pictures(240)]) == (100, HEIGHT)


def test_even_borders_that_are_no_bars() -> None:
    """Of one side, of different width, or all around somebody before a plain wall."""
    whole = [image[:, 50:150] for image in pictures()]
    assert picture_size(whole) == (HEIGHT, 100)
    assert picture_size([image[:, 50:] for image in pictures()]) == (HEIGHT, 150)
    assert picture_size([image[:, 20:] for image in pictures()]) == (HEIGHT, 180)
    around = [np.pad(image, ((30, 30), (0, 0), (0, 0))) for image in pictures()]
    assert picture_size(around) == (160, WIDTH)
    assert picture_size([np.zeros((HEIGHT, WIDTH, 3), np.uint8)]) == (HEIGHT, WIDTH)


def filled(blur: float, *, stretched: bool = False) -> list[NDArray[np.uint8]]:
    """Textures of 135 x 240, in the middle of a blurred copy that is 427 wide."""
    draw = np.random.default_rng(4)
    images = []
    for _ in range(4):
        coarse = draw.integers(0, 255, (24, 14, 3), dtype=np.uint8)
        fine = draw.integers(0, 40, (240, 135, 3), dtype=np.uint8)
        picture = cv2.addWeighted(cv2.resize(coarse, (135, 240)), 0.8, fine, 1.0, 0)
        copy = cv2.resize(picture, (427, 240 if stretched else 760))
        top = (len(copy) - 240) // 2
        image = cv2.GaussianBlur(copy[top : top + 240], (0, 0), blur)
        image[:, 146:281] = picture
        images.append(image)
    return images


@pytest.mark.parametrize(("blur", "stretched"), [(5.0, False), (12.0, True)])
def test_bars_that_are_filled_with_a_blurred_copy(blur: float, stretched: bool) -> None:
    """The person of an upright film in a wide video was too far away."""
    images = filled(blur, stretched=stretched)
    assert picture_size(images) == (240, 135)
    assert picture_size([np.rot90(image) for image in images]) == (135, 240)
    hidden = find_bars(images)
    assert hidden[:, :146].all() and hidden[:, 281:].all() and not hidden[:, 155:272].any()


def test_a_blurred_background_is_no_bar() -> None:
    """Of the picture itself; between two posts; or before a wall that is not a copy of it."""
    sharp = [image[:, 146:281] for image in filled(5.0)]
    assert picture_size(sharp) == (240, 135)
    wide = [cv2.resize(image, (427, 240)) for image in sharp]
    for image in wide:
        image[:, 140:146], image[:, 281:287] = 0, 0
    assert picture_size(wide) == (240, 427)
    wall = filled(5.0)
    for image in wall:
        ramp = np.linspace(0, 200, 240, dtype=np.uint8)[:, None, None]
        image[:, :146], image[:, 281:] = ramp, ramp
    assert picture_size(wall) == (240, 427)
