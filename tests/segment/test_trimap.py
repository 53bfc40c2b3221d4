"""The four regions around a posed model."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from disc_scene import disc

from perfcap.errors import InputError
from perfcap.segment.trimap import (
    BACKGROUND,
    FOREGROUND,
    PLAIN_TRIMAP,
    PROBABLE_BACKGROUND,
    PROBABLE_FOREGROUND,
    TrimapSettings,
    build_trimap,
    draw_bones,
    signed_distance,
)

NONE = np.zeros((0, 2, 2))
BONE = np.array([[[60.0, 75.0], [90.0, 75.0]]])


def test_regions_follow_equation_nine():
    model = disc((75, 75), 30)
    trimap = build_trimap(model, NONE, TrimapSettings(outer=0.1, inner=0.1))
    labels = trimap.full()
    radius = np.hypot(*(np.mgrid[:150, :150] - 75))
    assert trimap.size == 61
    assert (labels[radius < 23] == FOREGROUND).all()
    assert (labels[(radius > 25) & (radius < 29)] == PROBABLE_FOREGROUND).all()
    assert (labels[(radius > 31) & (radius < 36)] == PROBABLE_BACKGROUND).all()
    assert (labels[radius > 38] == BACKGROUND).all()
    assert set(np.unique(labels[model])) <= {FOREGROUND, PROBABLE_FOREGROUND}


def test_widths_are_in_proportion_and_capped():
    small, large = (build_trimap(disc((75, 75), r), NONE) for r in (20, 40))
    assert large.outer / large.size == pytest.approx(small.outer / small.size)
    capped = build_trimap(disc((75, 75), 40), NONE, TrimapSettings(limit=3.0))
    assert capped.outer == capped.inner == 3.0


def test_skeleton_is_believed_deep_inside_the_model_only():
    model = disc((75, 75), 30)
    wrong = np.array([[[75.0, 75.0], [140.0, 75.0]]])  # an arm that is not where the model is
    settings = TrimapSettings(inner=0.2, skeleton=0.05)
    labels = build_trimap(model, wrong, settings).full()
    assert (labels[75, 75:100] == FOREGROUND).all()
    assert not (labels[75, 104:] == FOREGROUND).any()
    plain = build_trimap(model, wrong, PLAIN_TRIMAP)
    row = plain.full()[75]
    assert (row[75 : min(140, plain.box[1].stop)] == FOREGROUND).all()


def test_feet_may_shade_the_ground_around_them():
    model = np.zeros((150, 150), bool)
    model[20:120, 60:80] = True
    shin, foot = [[70.0, 60.0], [70.0, 110.0]], [[70.0, 110.0], [90.0, 110.0]]
    bones = np.array([shin, foot])
    trimap = build_trimap(model, bones, feet=(1,))
    contact = np.zeros(trimap.shape, bool)
    contact[trimap.box] = trimap.contact
    assert not (contact & model).any()
    beyond_toes, beside_heel = contact[112, 94], contact[115, 59]
    assert beyond_toes and beside_heel
    rows = np.nonzero(contact.any(1))[0]
    reach = TrimapSettings().contact * trimap.size
    assert rows[0] >= 110 - reach and rows[-1] <= 110 + reach
    half = trimap.resize(0.5).contact
    assert half.shape == trimap.resize(0.5).labels.shape
    assert 4 * half.sum() == pytest.approx(trimap.contact.sum(), rel=0.25)
    for nowhere in (
        build_trimap(model, bones),
        build_trimap(model, np.full((2, 2, 2), np.nan), feet=(1,)),
        build_trimap(model, bones, PLAIN_TRIMAP, feet=(1,)),
    ):
        assert nowhere.contact is None
        assert nowhere.resize(0.5).contact is None


def test_image_border_is_no_outline():
    model = np.zeros((80, 60), bool)
    model[30:, 10:50] = True  # continues below the image
    trimap = build_trimap(model, NONE, TrimapSettings(outer=0.1, inner=0.1))
    assert trimap.full()[79, 30] == FOREGROUND
    assert trimap.box[0].stop == 80


def test_model_outside_the_image_and_filling_it():
    empty = build_trimap(np.zeros((20, 30), bool), BONE)
    assert empty.size == 0
    assert empty.labels.size == 0
    assert (empty.full() == BACKGROUND).all()
    full = build_trimap(np.ones((20, 30), bool), BONE)
    assert (full.full() == FOREGROUND).all()


@pytest.mark.parametrize(
    ("centre", "cropped"), [((40, 40), False), ((40, 5), True), ((76, 40), True)]
)
def test_border_that_cuts_the_model_off_is_told(centre, cropped):
    trimap = build_trimap(disc(centre, 10, (80, 80)), NONE)
    assert trimap.cropped == cropped
    assert trimap.resize(0.5).size == trimap.size / 2
    assert not build_trimap(np.zeros((20, 30), bool), BONE).cropped
    assert build_trimap(np.ones((20, 30), bool), BONE).cropped


def test_bones_that_are_not_finite_or_far_away():
    bones = np.array(
        [
            [[np.nan, 0], [5, 5]],
            [[-1e12, 10], [1e12, 10]],
            [[1e9, 1e9], [1e9, 1e9]],
            [[3, -5e8], [3, 5e8]],
        ]
    )
    drawn = draw_bones(bones, (20, 20))
    assert drawn[10].all()
    assert drawn[:, 3].all()
    assert drawn.sum() == 39


def test_resized_regions_stay_where_they_are():
    trimap = build_trimap(disc((75, 75), 40), BONE, TrimapSettings(inner=0.2))
    small = trimap.resize(0.5)
    assert small.size == trimap.size / 2
    back = np.repeat(np.repeat(small.labels, 2, 0), 2, 1)
    rows, columns = (min(a, b) for a, b in zip(back.shape, trimap.labels.shape, strict=True))
    same = back[:rows, :columns] == trimap.labels[:rows, :columns]
    assert same.mean() > 0.95
    assert (small.labels == FOREGROUND).sum() > 12  # the bone has not vanished


def test_distance_is_signed_and_in_pixels():
    distance = signed_distance(disc((75, 75), 30))
    radius = np.hypot(*(np.mgrid[:150, :150] - 75))
    np.testing.assert_allclose(distance, 30 - radius, atol=1.6)


@pytest.mark.parametrize(
    ("model", "bones", "word"),
    [
        (np.zeros((5, 5), np.uint8), NONE, "model"),
        (np.zeros((5, 5, 3), bool), NONE, "model"),
        (np.zeros((5, 5), bool), np.zeros((3, 2)), "bones"),
    ],
)
def test_other_arrays_are_refused(model, bones, word):
    with pytest.raises(InputError, match=word):
        build_trimap(model, bones)


def test_the_ground_around_feet_is_looked_at_no_further_than_their_shade() -> None:
    model = np.zeros((90, 120), bool)
    model[10:60, 40:60] = True
    feet = np.array([[[42.0, 58], [36, 61]], [[58, 58], [66, 63]], [[np.nan, 0], [0, 0]]])
    found = build_trimap(model, feet, feet=(0, 1, 2))
    lines = np.zeros((90, 120), np.uint8)
    for ankle, toes in feet[:2]:
        ends = np.rint([1.5 * ankle - 0.5 * toes, 1.3 * toes - 0.3 * ankle]).astype(int)
        cv2.line(lines, *map(tuple, ends.tolist()), 1)
    away = cv2.distanceTransform(1 - lines, cv2.DIST_L2, cv2.DIST_MASK_5)[found.box]
    assert found.contact is not None
    reach, outside = 0.06 * found.size, ~model[found.box]
    assert found.contact[(away < reach - 1.5) & outside].all()
    assert not found.contact[(away > reach + 1.5) | ~outside].any()
