"""Whose a pixel is before colours are looked at: near outlines, behind others, far away."""

import numpy as np
import pytest
from disc_scene import disc

from perfcap.segment.label_people import in_front, shape_prior
from perfcap.segment.person_layer import PersonLayer, Surroundings

WHOLE = slice(0, 150), slice(0, 150)


def layer(mask, depth, spread=3.0, doubt=0.02) -> PersonLayer:
    far = np.where(mask, np.float32(depth), np.float32(np.inf))
    return PersonLayer.of(far, np.where(mask, 0, -1), np.float32([spread]), doubt)


def prior(*layers, doubt=0.03):
    return shape_prior([each.seen_from(WHOLE) for each in layers], doubt)


def half(column) -> np.ndarray:
    return np.broadcast_to(np.arange(150) < column, (150, 150))


def test_the_nearer_covers_the_farther() -> None:
    one, other = disc((60, 75), 40), disc((90, 75), 40)
    both = one & other
    deep = disc((60, 75), 34) & disc((90, 75), 34)
    first = prior(layer(one, 2.0), layer(other, 3.0))
    second = prior(layer(one, 3.0), layer(other, 2.0))
    np.testing.assert_allclose(first.sum(0), 1, rtol=1e-5)
    assert (first[0][both] > 0.5).all() and (second[1][both] > 0.5).all()
    assert (first[0][deep] > 0.95).all() and (second[1][deep] > 0.95).all()
    assert (first[0][75, 25:35] > 0.99).all() and (first[1][75, 115:125] > 0.99).all()


def test_who_stands_at_one_depth_is_not_known() -> None:
    same = prior(layer(half(100), 2.0), layer(half(100), 2.0))
    np.testing.assert_allclose(same, 0.5, atol=1e-6)
    unsure = prior(layer(half(100), 2.0), layer(half(100), 2.02), doubt=0.1)
    assert 0.5 < unsure[0, 75, 50] < 0.7


def test_it_is_what_samples_of_poses_show() -> None:
    """Eq. 22 of Liu et al. 2013 by sampling: outlines moved sideways, drawn nearest first."""
    rng = np.random.default_rng(0)
    spread, count = 4.0, 4000
    columns = np.arange(150) + 0.0
    found = prior(layer(half(70), 2.0, spread), layer(half(110), 3.0, spread))[:, 75]
    front = 69.5 + rng.logistic(scale=spread * np.sqrt(3) / np.pi, size=count)
    back = 109.5 + rng.logistic(scale=spread * np.sqrt(3) / np.pi, size=count)
    shown = (columns < front[:, None]).mean(0)
    behind = ((columns >= front[:, None]) & (columns < back[:, None])).mean(0)
    near = slice(50, 100)
    expected = shown[near] / (shown + behind)[near]
    assert np.abs(found[0][near] - expected).max() < 0.05


def test_what_is_hidden_may_come_out_again() -> None:
    """A limb just behind the outline of somebody nearer keeps a probability."""
    front, limb = half(75), np.zeros((150, 150), bool)
    limb[60:90, 40:74] = True
    found = prior(layer(front, 2.0, 4.0), layer(limb, 2.5, 4.0))
    assert found[1, 75, 73] > 0.2 and found[1, 75, 78] > 0.3
    assert found[1, 75, 45] < 0.05


def test_depths_that_are_not_known_say_nothing_wrong() -> None:
    nobody = layer(np.zeros((150, 150), bool), 2.0)
    one = layer(half(70), 2.0)
    found = prior(one, nobody)
    assert np.isfinite(found).all() and (found[0] > 0.5).all()
    around = [each.seen_from(WHOLE) for each in (one, nobody)]
    assert (in_front(*around, 0.05) == 1).all() and (in_front(*around[::-1], 0.05) < 1e-9).all()


def test_a_layer_is_continued_by_what_is_nearest() -> None:
    rng = np.random.default_rng(1)
    mask = disc((40, 45), 12, (80, 80))
    depth = np.where(mask, rng.uniform(1, 3, mask.shape), np.inf).astype(np.float32)
    part = np.where(mask, rng.integers(0, 3, mask.shape), -1)
    drawn = PersonLayer.of(depth, part, np.float32([1, 2, 4]), 0.1)
    np.testing.assert_array_equal(drawn.mask, mask)
    box = slice(30, 75), slice(20, 79)
    found = drawn.seen_from(box)
    inside = mask[box]
    np.testing.assert_array_equal(found.depth[inside], depth[box][inside])
    np.testing.assert_array_equal(found.part[inside], part[box][inside])
    np.testing.assert_array_equal(found.spread, np.float32([1, 2, 4])[found.part])
    rows, columns = np.nonzero(inside)
    for row, column in ((0, 0), (44, 58), (20, 50), (40, 3)):
        apart = np.hypot(rows - row, columns - column)
        near = apart < apart.min() + 1.0  # the transform is good to a few percent
        assert found.depth[row, column] in found.depth[rows[near], columns[near]]
        assert found.distance[row, column] == pytest.approx(0.5 - apart.min(), abs=1.0)


def test_a_layer_of_a_piece_of_the_image() -> None:
    rng = np.random.default_rng(1)
    mask = disc((40, 45), 12, (80, 80))
    depth = np.where(mask, rng.uniform(1, 3, mask.shape), np.inf).astype(np.float32)
    part = np.where(mask, rng.integers(0, 3, mask.shape), -1)
    whole = PersonLayer.of(depth, part, np.float32([1, 2, 4]), 0.1)
    piece = slice(20, 70), slice(15, 80)
    found = PersonLayer.of(
        depth[piece], part[piece], np.float32([1, 2, 4]), 0.1, (20, 15), (80, 80)
    )
    assert found.box == whole.box and found.shape == whole.shape
    np.testing.assert_array_equal(found.mask, mask)
    np.testing.assert_array_equal(found.depth, whole.depth)


def test_a_part_of_the_image_without_the_person() -> None:
    drawn = layer(disc((40, 40), 10), 2.0)
    found = drawn.seen_from((slice(100, 120), slice(90, 130)))
    assert found.depth.shape == (20, 40) and not np.isfinite(found.depth).any()
    assert (found.distance < -1000).all()
    assert isinstance(found, Surroundings)
