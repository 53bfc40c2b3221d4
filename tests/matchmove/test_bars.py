"""Bars beside a picture, whose edges stand still however the camera moves."""

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
