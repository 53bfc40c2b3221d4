"""Texture that moves: known shifts, others' texture, nothing to find."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from perfcap.segment.texture import Features, find_features, match_features


def picture(seed: int = 0) -> NDArray[np.uint8]:
    noise = np.random.default_rng(seed).uniform(0, 255, (140, 160, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), 3)
    wide = (smooth - smooth.min()) / np.ptp(smooth) * 255
    return wide.astype(np.uint8)


def mask(left: int = 40) -> NDArray[np.bool_]:
    inside = np.zeros((140, 160), np.bool_)
    inside[30:110, left : left + 70] = True
    return inside


@pytest.mark.parametrize("shift", [(0, 0), (7, -3)])
def test_pairs_are_shifted_as_the_picture_is(shift: tuple[int, int]) -> None:
    image = picture()
    moved = np.roll(image, shift[::-1], (0, 1))
    before, after = find_features(image, mask()), find_features(moved, mask(40 + shift[0]))
    pairs = match_features(before, after, reach=15)
    assert len(pairs) > 20
    steps = after.points[pairs[:, 1]] - before.points[pairs[:, 0]]
    assert np.median(np.abs(steps - shift)) < 0.1
    assert (np.abs(steps - shift).max(1) < 1).mean() > 0.9


def test_features_are_in_the_mask() -> None:
    found = find_features(picture(), mask())
    column, row = np.rint(found.points).astype(int).T
    assert len(found.points) > 20
    assert mask()[row, column].all()


def test_what_moves_too_far_is_not_followed() -> None:
    image = picture()
    far = np.roll(image, 30, 1)
    before, after = find_features(image, mask()), find_features(far, mask(70))
    steps = match_features(before, after, reach=40)
    assert len(steps) > 20
    near = match_features(before, after, reach=10)
    moved = after.points[near[:, 1]] - before.points[near[:, 0]]
    assert (np.linalg.norm(moved, axis=1) <= 10).all()


def test_another_picture_is_not_recognised() -> None:
    before, after = find_features(picture(0), mask()), find_features(picture(1), mask())
    assert len(match_features(before, after, 200)) < 0.1 * len(before.points)


def test_each_is_the_best_of_the_other() -> None:
    descriptors = np.eye(128, dtype=np.float32)[:3] * 100
    before = Features(np.zeros((3, 2)), descriptors)
    after = Features(np.zeros((2, 2)), descriptors[[2, 0]])
    assert match_features(before, after, 1.0).tolist() == [[0, 1], [2, 0]]


def test_nobody_is_the_best_of_two() -> None:
    unit = np.eye(128, dtype=np.float32) * 100
    before = Features(np.zeros((2, 2)), np.stack([0.9 * unit[0], unit[0]]))
    after = Features(np.zeros((2, 2)), unit[:2])
    assert match_features(before, after, 1.0).tolist() == [[1, 0]]


def test_nothing_to_find() -> None:
    nobody = np.zeros((140, 160), np.bool_)
    none = find_features(picture(), nobody)
    plain = find_features(np.zeros((140, 160, 3), np.uint8), mask())
    assert len(none.points) == len(plain.points) == 0
    assert match_features(none, find_features(picture(), mask()), 10).shape == (0, 2)
