"""Whose a pixel is by samples of poses: how often it shows whom."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.stats import norm

from perfcap.errors import InputError
from perfcap.render import rasterize
from perfcap.segment.shape_samples import SampledPeople, ShapeSamples, tempered

SIZE = 60
WHOLE = slice(0, SIZE), slice(0, SIZE)
ALL = np.ones((SIZE, SIZE), bool)
EVEN = np.full((2, SIZE, SIZE), 0.5, np.float32)
# corners of a box and its triangles, counter-clockwise seen from outside where y points down
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
FACES = np.array(
    [
        [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3], [0, 1, 3], [0, 3, 2],
        [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
    ]
)  # fmt: skip


def people(boxes, settings=None, shifts=((0.0, 0.0),), parts=1) -> SampledPeople:
    """Boxes ((left, top, near), (right, bottom, far)) px and m; shifts (N, K) px to the right."""
    shifts = np.broadcast_to(shifts, (len(shifts), len(boxes)))
    points = np.stack([np.array(low) + CORNERS * np.subtract(high, low) for low, high in boxes])
    moved = np.repeat(points[None], len(shifts), 0)  # N K 8 3
    moved[..., 0] += shifts[..., None]
    moved = torch.from_numpy(moved.reshape(len(shifts), -1, 3))
    faces = torch.from_numpy(np.concatenate([FACES + 8 * k for k in range(len(boxes))]))
    labels = np.repeat(np.arange(len(boxes)) * parts, len(FACES)).astype(np.int16)
    shares = np.full((len(boxes), parts), 1 / parts)
    given = moved[..., :2], moved[..., 2], faces, labels, shares, 0.0
    return SampledPeople(*given, settings or ShapeSamples(culled=False))


NEAR = (10.0, 10.0, 2.0), (35.0, 45.0, 2.4)
FAR = (25.0, 5.0, 3.0), (50.0, 50.0, 3.4)


def test_poses_that_are_sure_show_the_label_map() -> None:
    drawn = people([NEAR, FAR], shifts=np.zeros((300, 2)))
    map_ = rasterize(drawn.pixels[0], drawn.depth[0], drawn.faces, (SIZE, SIZE))
    truth = map_.label(torch.from_numpy(drawn.labels.astype(np.int64)), -1).numpy()
    np.testing.assert_array_equal(drawn.shown(WHOLE), np.broadcast_to(truth, (300, SIZE, SIZE)))
    found = drawn.prior(WHOLE, ALL, EVEN)
    np.testing.assert_allclose(found.sum(0), 1, rtol=1e-5)
    for number in range(2):
        assert (found[number][truth == number] > 0.998).all()
    np.testing.assert_allclose(found[:, truth < 0], 0.5)  # nobody: what the closed form says
    part = slice(7, 40), slice(20, 55)
    np.testing.assert_array_equal(drawn.shown(part)[0], truth[part])


def test_frequency_is_the_probability_of_what_is_drawn_from() -> None:
    deviation, count = 4.0, 4000
    shifts = np.random.default_rng(0).normal(scale=deviation, size=(count, 2))
    found = people([NEAR, FAR], shifts=shifts).prior(WHOLE, ALL, EVEN)[0, 30]
    column = np.arange(28, 45)
    near = norm.sf(column, 35, deviation) * norm.cdf(column, 10, deviation)
    far = norm.cdf(column, 25, deviation) * norm.sf(column, 50, deviation) * (1 - near)
    assert np.abs(found[column] - near / (near + far)).max() < 0.03


def test_mirrored_people_have_a_mirrored_prior() -> None:
    shifts = np.random.default_rng(1).normal(scale=3.0, size=(50, 2))
    other = [((59 - b[0], *a[1:]), (59 - a[0], *b[1:])) for a, b in (NEAR, FAR)]
    found = [
        people(boxes, shifts=sign * shifts).prior(WHOLE, ALL, EVEN)
        for boxes, sign in (([NEAR, FAR], 1), (other, -1))
    ]
    np.testing.assert_allclose(found[0], found[1][:, :, ::-1], rtol=1e-6)


def test_each_sample_twice_changes_only_what_the_closed_form_counts() -> None:
    shifts = np.random.default_rng(2).normal(scale=3.0, size=(100, 2))
    once, twice = (
        people([NEAR, FAR], shifts=each).prior(WHOLE, ALL, EVEN)
        for each in (shifts, np.concatenate([shifts, shifts]))
    )
    covered = people([NEAR, FAR], shifts=shifts).shown(WHOLE) >= 0
    often = covered.mean(0) > 0.5
    assert np.abs(once - twice)[:, often].max() < 0.01


def test_who_is_inside_another_is_shown_without_front_faces() -> None:
    hand = (15.0, 15.0, 2.1), (25.0, 25.0, 2.2)
    middle = np.s_[0, 18:22, 18:22]
    plain = people([NEAR, hand])
    culled = people([NEAR, hand], ShapeSamples())
    assert (plain.shown(WHOLE)[middle] == 0).all() and (culled.shown(WHOLE)[middle] == 1).all()
    # beside it, and behind, nothing changes: whose back is nearer is in front
    np.testing.assert_array_equal(culled.shown(WHOLE)[0, 28:], plain.shown(WHOLE)[0, 28:])
    apart = people([NEAR, FAR]), people([NEAR, FAR], ShapeSamples())
    np.testing.assert_array_equal(*[each.shown(WHOLE) for each in apart])
    # a part inside another part of the same person stays hidden
    one = people([NEAR, hand], ShapeSamples(), parts=16)
    one = replace(one, labels=np.where(one.labels == 16, 1, one.labels).astype(np.int16))
    assert (one.shown(WHOLE)[middle] == 0).all()


def test_samples_that_fit_the_foreground_count_more() -> None:
    shifts = np.array([[-6.0, -6.0], [0.0, 0.0], [6.0, 6.0]])
    foreground = people([NEAR, FAR]).shown(WHOLE)[0] >= 0
    found = [
        people([NEAR, FAR], ShapeSamples(effective=share), shifts).prior(WHOLE, foreground, EVEN)
        for share in (0.0, 0.5, 1.0)
    ]
    # the column that the middle and the right one give to the nearer person
    values = [float(each[0, 30, 33]) for each in found]
    assert values[0] > 0.85 and values[0] >= values[1] > values[2] > 0.5


def test_weights_are_flattened_until_enough_samples_count() -> None:
    nats = np.random.default_rng(3).uniform(0, 1e4, 200)
    nats -= nats.min()
    for share in (0.0, 0.1, 0.5, 0.99):
        weights = tempered(nats, share)
        assert weights.sum() == pytest.approx(1)
        assert 1 / np.square(weights).sum() >= share * 200 * (1 - 1e-6)
        assert (np.diff(weights[np.argsort(nats)]) <= 0).all()
    assert tempered(nats, 0.0).max() > 0.9
    np.testing.assert_allclose(tempered(np.zeros(5), 1.0), 0.2)


@pytest.mark.parametrize(
    "wrong",
    [{"count": 0}, {"count": 2.5}, {"effective": 1.5}, {"cell": -1.0}, {"center": "next"},
     {"spread": (0.1, -0.1, 0.1)}],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(wrong) -> None:
    with pytest.raises(InputError, match=f"{next(iter(wrong))} of ShapeSamples"):
        ShapeSamples(**wrong)


def test_meshes_that_do_not_fit_are_refused() -> None:
    drawn = people([NEAR, FAR])
    with pytest.raises(InputError, match="pixels has shape"):
        replace(drawn, pixels=drawn.pixels[:, :3])
    with pytest.raises(InputError, match="labels has"):
        replace(drawn, labels=drawn.labels[:3])
