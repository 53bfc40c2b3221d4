"""A person found from a model that is a few pixels off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from box_grabcut import box_grabcut
from disc_scene import disc, disc_clip, overlap

from perfcap.errors import InputError
from perfcap.segment.background import Lighting, Plate
from perfcap.segment.evidence import Backdrop, Pixels, learn_colors, log_ratio
from perfcap.segment.grabcut import segment
from perfcap.segment.mixed_pixels import settle_mixed
from perfcap.segment.scene import survey
from perfcap.segment.settings import MODEL_ONLY, PAPER, GrabCutSettings
from perfcap.segment.trimap import build_trimap

MIDDLE = 6
ALONE = GrabCutSettings(use_plate=False)
SIMILAR = ((60, 90, 80), (130, 160, 140))  # colours of the scene, nearly


def find(clip, settings=None, plate=None, index=MIDDLE, **extra):
    settings = settings or GrabCutSettings()
    trimap = build_trimap(clip.models[index], clip.bones[index], settings.trimap)
    adjacent = [clip.images[i][trimap.box] for i in (index - 1, index + 1)]
    plate = None if plate is None else plate[trimap.box]
    return segment(clip.images[index], trimap, settings, adjacent=adjacent, plate=plate, **extra)


@pytest.fixture(scope="module")
def clip():
    return disc_clip()


@pytest.mark.parametrize("settings", [ALONE, PAPER, MODEL_ONLY], ids=["alone", "paper", "model"])
def test_distinct_colors_are_enough(clip, settings):
    settings = replace(settings, trimap=replace(settings.trimap, outer=0.15, inner=0.12))
    assert overlap(clip.models[MIDDLE], clip.truth[MIDDLE]) < 0.87
    assert overlap(find(clip, settings).mask, clip.truth[MIDDLE]) > 0.97


def test_plate_finds_what_colors_cannot():
    clip = disc_clip(frames=25, person=SIMILAR, error=(5.0, -4.0))
    scene = survey(clip.images, clip.models)
    alone, backed = (find(clip, plate=plate, index=12) for plate in (None, scene.plate))
    assert overlap(backed.mask, clip.truth[12]) > 0.94
    assert overlap(backed.mask, clip.truth[12]) > overlap(alone.mask, clip.truth[12]) + 0.03
    assert backed.report.plate > 0.5
    assert alone.report.plate == 0


def test_colors_of_neither_side_speak_for_neither():
    rng = np.random.default_rng(0)
    image = rng.normal(scale=3, size=(20, 40, 3)).astype(np.float32)
    image[:, :20] += (200, 60, 60)
    image[:, 20:] += (60, 60, 200)
    image[0, 0] = (60, 250, 60)
    left = np.arange(40) < 20
    inside = np.broadcast_to(left, (20, 40)).copy()
    pure = inside.copy()
    pure[0, 0] = False
    models = learn_colors(image, pure, inside, None, ALONE.color)
    assert models is not None
    everywhere = np.ones_like(inside)
    pixels = Pixels.of(image, everywhere, None, ALONE)
    sure, fair = (
        log_ratio(pixels, models, replace(ALONE, unseen=share)).reshape(20, 40)
        for share in (0.0, 0.1)
    )
    assert sure[0, 0] == ALONE.limit
    assert fair[0, 0] == pytest.approx(np.log(ALONE.alone.surprise / 0.1), abs=1e-3)
    assert (fair[pure] > 3).all()
    assert (fair[:, 20:] < -3).all()


def test_motion_cue_helps_where_contrast_is_weak():
    errors = []
    for seed in range(4):
        clip = disc_clip(seed=seed, person=SIMILAR, error=(3.0, -2.0))
        moving, still = (find(clip, s) for s in (PAPER, MODEL_ONLY))
        assert moving.report.motion
        assert not still.report.motion
        errors.append([overlap(f.mask, clip.truth[MIDDLE]) for f in (moving, still)])
    assert np.mean(errors, 0)[0] > np.mean(errors, 0)[1]


def test_coarse_first_agrees_with_the_full_image(clip):
    scene = survey(clip.images, clip.models)
    full = find(clip, replace(GrabCutSettings(), coarse=None), scene.plate)
    coarse = find(clip, replace(GrabCutSettings(), coarse=30.0), scene.plate)
    assert overlap(full.mask, coarse.mask) > 0.97
    assert overlap(coarse.mask, clip.truth[MIDDLE]) > 0.97
    assert coarse.evidence.shape == full.evidence.shape


def test_result_is_the_same_every_time(clip):
    one, other = (find(clip, ALONE) for _ in range(2))
    np.testing.assert_array_equal(one.mask, other.mask)
    np.testing.assert_array_equal(one.evidence, other.evidence)
    warm = [find(clip, ALONE, warm=one.models) for _ in range(2)]
    np.testing.assert_array_equal(warm[0].mask, warm[1].mask)
    assert overlap(warm[0].mask, one.mask) > 0.95


def test_mixed_pixels_go_to_the_side_they_have_more_of():
    share = np.clip(np.linspace(-4.3, 5.7, 21), 0, 1)[None, :, None] * np.ones((9, 1, 3))
    behind = np.full((9, 21, 3), 60, np.uint8)
    image = np.rint(share * 200 + (1 - share) * 60).astype(np.uint8)
    known = np.ones((9, 21), bool)
    plate = Plate(behind, np.ones((9, 21), np.float32), known)
    light = np.ones((9, 21, 3), np.float32), np.zeros((9, 21), np.float32)
    backdrop = Backdrop(plate, Lighting(np.ones(3, np.float32), 1.0, *light))
    right = share[..., 0] > 0.5
    for shift in (-1, 1):  # a mask that is a pixel too wide or too narrow
        wrong = np.roll(right, shift, 1)
        wrong[:, 0], wrong[:, -1] = False, True
        np.testing.assert_array_equal(settle_mixed(wrong, image, backdrop, known), right)
        unknown = replace(backdrop, plate=replace(plate, known=~known))
        np.testing.assert_array_equal(settle_mixed(wrong, image, unknown, known), wrong)
        np.testing.assert_array_equal(settle_mixed(wrong, image, backdrop, ~known), wrong)


def test_a_rim_of_a_third_colour_is_no_mixture():
    """Grazing light on a sleeve is darker than the wall behind it, and still the sleeve."""
    shades = np.repeat([200, 20, 60], [10, 1, 10])
    image = np.rint(shades[None, :, None] * np.ones((9, 1, 3))).astype(np.uint8)
    known = np.ones((9, 21), bool)
    plate = Plate(np.full((9, 21, 3), 60, np.uint8), np.ones((9, 21), np.float32), known)
    light = np.ones((9, 21, 3), np.float32), np.zeros((9, 21), np.float32)
    backdrop = Backdrop(plate, Lighting(np.ones(3, np.float32), 1.0, *light))
    sleeve = np.broadcast_to(shades != 60, (9, 21))
    np.testing.assert_array_equal(settle_mixed(sleeve, image, backdrop, known), sleeve)


def test_every_cue_can_be_left_out():
    clip = disc_clip(frames=25, error=(5.0, -4.0))
    plate = survey(clip.images, clip.models).plate
    blind = replace(GrabCutSettings(), use_colors=False)
    plate_alone = find(clip, blind, plate, index=12)
    assert plate_alone.report.plate > 0.5
    assert overlap(plate_alone.mask, clip.truth[12]) > 0.94
    assert not find(clip, replace(blind, use_plate=False), plate, index=12).evidence.any()
    without = find(clip, ALONE, plate, index=12)
    assert without.report.plate == 0
    assert without.evidence.any()


def test_mask_stays_within_the_trimap(clip):
    found = find(clip, ALONE)
    labels = found.trimap.full()
    assert found.mask[labels == 1].all()
    assert not found.mask[labels == 0].any()


@pytest.mark.parametrize("filled", [False, True], ids=["empty", "full"])
def test_models_outside_and_all_over_the_image(clip, filled):
    model = np.full(clip.models[0].shape, filled)
    trimap = build_trimap(model, clip.bones[0])
    found = segment(clip.images[0], trimap)
    np.testing.assert_array_equal(found.mask, model)
    assert found.report.person == filled
    assert found.report.cropped == filled
    np.testing.assert_array_equal(box_grabcut(clip.images[0], model), model)


def test_tiny_models_and_flat_images():
    flat = np.full((40, 40, 3), 128, np.uint8)
    for radius in (0, 1, 3):
        model = disc((3, 20), radius, (40, 40))
        found = segment(flat, build_trimap(model, np.zeros((0, 2, 2))))
        assert found.mask.shape == (40, 40)
        assert np.isfinite(found.evidence).all()


def test_frames_of_another_size_are_refused(clip):
    trimap = build_trimap(clip.models[0], clip.bones[0])
    for frame in (clip.images[0][:-1], clip.images[0].astype(float), clip.images[0][..., 0]):
        with pytest.raises(InputError, match="frame"):
            segment(frame, trimap)
    small = clip.images[0][trimap.box][:-1]
    with pytest.raises(InputError, match="adjacent"):
        segment(clip.images[0], trimap, adjacent=[small])
    plate = Plate(small, np.ones(small.shape[:2], np.float32), np.ones(small.shape[:2], bool))
    with pytest.raises(InputError, match="plate"):
        segment(clip.images[0], trimap, plate=plate)


def test_box_baseline_uses_nothing_but_the_box(clip):
    square = np.zeros_like(clip.models[MIDDLE])
    rows, columns = np.nonzero(clip.models[MIDDLE])
    square[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
    one, other = (box_grabcut(clip.images[MIDDLE], m) for m in (square, clip.models[MIDDLE]))
    np.testing.assert_array_equal(one, other)
    assert overlap(one, clip.truth[MIDDLE]) > 0.8


@pytest.mark.parametrize("level", [0, 128, 255])
def test_an_image_of_one_color_has_no_mask(clip, level):
    rng = np.random.default_rng(0)
    trimap = build_trimap(clip.models[MIDDLE], clip.bones[MIDDLE], ALONE.trimap)
    noise = level + rng.integers(-2, 3, clip.images[MIDDLE].shape)
    blank = np.clip(noise, 0, 255).astype(np.uint8)
    blank[trimap.box][0, 0] = 255 - level  # a hot pixel is nothing either
    found = segment(blank, trimap, ALONE)
    assert found.report.blank and found.report.person and not found.mask.any()
    assert not segment(clip.images[MIDDLE], trimap, ALONE).report.blank
