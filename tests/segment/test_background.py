"""Plates, light on them, and how well colours fit."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest
from disc_scene import disc, disc_clip, texture

from perfcap.segment import _background_numba
from perfcap.segment.background import (
    PlateSettings,
    background_density,
    build_plate,
    find_lighting,
)
from perfcap.segment.scene import SceneSettings, hide, sample_frames, shift_of, survey
from perfcap.segment.trimap import signed_distance

SETTINGS = PlateSettings()


@pytest.fixture(scope="module")
def still():
    """A textured plate known everywhere, its image, and a disc in the middle of it."""
    rng = np.random.default_rng(0)
    behind = texture(rng, (80, 80), (20, 40, 30), (220, 240, 230), 1.5)
    images = np.clip(behind + rng.normal(scale=1.5, size=(9, 80, 80, 3)), 0, 255).astype(np.uint8)
    plate = build_plate(images, np.zeros((9, 80, 80), bool), SETTINGS)
    return plate, images[0].astype(np.float32), disc((40, 40), 18, (80, 80))


def density(image, plate, around, contact=None):
    lighting = find_lighting(image, around, plate, SETTINGS, contact)
    everywhere = np.ones(image.shape[:2], bool)
    found = background_density(image, everywhere, plate, lighting, SETTINGS)
    return found.reshape(image.shape[:2]), lighting


def test_median_equals_numpy():
    rng = np.random.default_rng(1)
    images = rng.integers(0, 256, (7, 40, 35, 3)).astype(np.uint8)
    hidden = rng.random((7, 40, 35)) < 0.5
    hidden[:, 0, 0] = True
    color, spread = np.zeros((40, 35, 3), np.uint8), np.zeros((40, 35), np.float32)
    seen = np.zeros((40, 35), np.uint8)
    _background_numba.masked_median(images, hidden, color, spread, seen)
    np.testing.assert_array_equal(seen, (~hidden).sum(0))
    for row, column in np.argwhere(seen > 0):
        values = np.sort(images[~hidden[:, row, column], row, column].astype(float), 0)
        count = len(values)
        np.testing.assert_array_equal(color[row, column], values[(count - 1) // 2])
        quartiles = values[3 * count // 4] - values[count // 4]
        assert spread[row, column] == pytest.approx(quartiles.mean())


def test_density_equals_numpy(still):
    plate, image, person = still
    lighting = find_lighting(image, ~person, plate, SETTINGS)
    found = background_density(image, person, plate, lighting, SETTINGS)
    behind = plate.color[person] * lighting.gain
    variance = plate.deviation[person] ** 2 + max(lighting.noise, SETTINGS.noise) ** 2
    terms = []
    for weight, light, extra, strain in (
        (1 - SETTINGS.shadow_prior - SETTINGS.clutter, 1, 0, 0),
        (SETTINGS.shadow_prior, lighting.light[person], SETTINGS.shadow_noise**2,
         lighting.strain[person]),
    ):  # fmt: skip
        total = variance + extra
        squared = ((image[person] - light * behind) ** 2).sum(-1)
        terms.append(
            np.log(weight) - squared / total / 2 - 1.5 * np.log(2 * np.pi * total) - strain
        )
    np.testing.assert_allclose(found, np.logaddexp(*terms), rtol=1e-4, atol=1e-3)


def test_plate_fits_and_a_person_does_not(still):
    plate, image, person = still
    visited = image.copy()
    visited[person] = (200, 30, 30)
    fits, _ = density(visited, plate, ~person)
    assert np.median(fits[person]) < np.median(fits[~person]) - 20


def test_exposure_is_compensated(still):
    plate, image, person = still
    fits, lighting = density(image * np.float32(0.8), plate, ~person)
    np.testing.assert_allclose(lighting.gain, 0.8, atol=0.02)
    assert np.median(fits[person]) > -12


def test_shadow_keeps_texture_and_flat_cloth_does_not(still):
    plate, image, person = still
    shaded, covered = image.copy(), image.copy()
    shaded[person] *= 0.6
    covered[person] = 0.6 * image[person].mean(0)
    inner = disc((40, 40), 12, (80, 80))
    shadow, _ = density(shaded, plate, ~person)
    cloth, _ = density(covered, plate, ~person)
    assert np.median(shadow[inner]) > np.median(cloth[inner]) + 8


def test_dark_steep_shadows_are_expected_around_feet_alone(still):
    """A contact shadow: black under the foot, full light six pixels further down."""
    plate, image, foot = still
    rows = np.mgrid[:80, :80][0]
    below = (rows >= 58) & (rows < 64) & (abs(np.mgrid[:80, :80][1] - 40) < 14) & ~foot
    shaded = image * np.where(below, 0.2 + 0.12 * (rows - 58), 1)[..., None].astype(np.float32)
    shaded[foot] = (60, 40, 35)
    around = np.hypot(*(np.mgrid[:80, :80] - 40)) > 30
    contact = (rows > 50) & (rows < 68) & ~foot
    plain, lighting = density(shaded, plate, around)
    forgiven, eased = density(shaded, plate, around, contact)
    dark = below & (rows < 61)
    assert np.median(forgiven[dark]) > np.median(plain[dark]) + 10
    assert (eased.strain <= lighting.strain).all()
    np.testing.assert_array_equal(forgiven[~contact], plain[~contact])
    lit = image.copy()  # nothing about a foot makes the ground brighter
    lit[below] = np.minimum(image[below] * 1.6, 255)
    bright, _ = density(lit, plate, around, contact)
    plain, _ = density(lit, plate, around)
    assert np.median(bright[below]) < np.median(plain[below]) + 2
    _, nowhere = density(shaded, plate, around, np.zeros_like(foot))
    np.testing.assert_array_equal(nowhere.strain, lighting.strain)


def test_next_to_a_person_the_light_comes_from_the_other_side(still):
    plate, image, person = still
    visited = image.copy()
    visited[40:] *= 0.6  # in shadow
    visited[person] = (200, 30, 30)
    fits, _ = density(
        visited, plate, ~(disc((40, 40), 30, (80, 80))) & (np.arange(80) < 40)[:, None]
    )
    rim = disc((40, 40), 20, (80, 80)) & ~person
    rim[:46] = False
    assert np.median(fits[rim]) > np.median(fits[person]) + 10


def test_another_scene_is_not_compared_with(still):
    plate, image, person = still
    assert find_lighting(255 - image, ~person, plate, SETTINGS) is None
    assert find_lighting(image, np.zeros_like(person), plate, SETTINGS) is None


@pytest.mark.parametrize("count", [1, 2, 3, 7, 10])
def test_comparisons_sort_everything(count):
    """What sorts zeros and ones sorts all numbers."""
    for bits in itertools.product((0, 1), repeat=count):
        values = list(bits)
        for low, high in _background_numba._comparators(count):
            values[low], values[high] = sorted((values[low], values[high]))
        assert values == sorted(bits)


def test_survey_sees_behind_a_person_who_moves():
    clip = disc_clip(frames=25, speed=5.0)
    scene = survey(clip.images, clip.models)
    assert scene.plate is not None
    assert scene.used == 25
    assert scene.shift < 0.2
    empty = np.median([im for im, m in zip(clip.images, clip.models, strict=True)], 0)
    known = scene.plate.known
    assert known.mean() > 0.9
    assert np.abs(scene.plate.color[known] - empty[known]).mean() < 15
    assert known[clip.truth[12]].mean() > 0.5


def test_survey_of_a_camera_that_turns_and_of_a_person_who_never_moves():
    assert survey(*_part(disc_clip(frames=9, pan=4.0))).plate is None
    scene = survey(*_part(disc_clip(frames=9, speed=0.0)))
    assert scene.plate is not None
    assert not scene.plate.known[disc((75, 77), 25)].any()


def test_survey_leaves_out_samples_of_another_shot():
    clip, other = (
        disc_clip(frames=9),
        disc_clip(frames=2, seed=5, scene=((150, 30, 90), (250, 90, 10))),
    )
    images = np.concatenate([clip.images, other.images])
    models = np.concatenate([clip.models, other.models])
    scene = survey(images, models)
    assert scene.plate is not None
    assert scene.used == 9


def test_shift_is_told_from_noise_and_light():
    rng = np.random.default_rng(4)
    nothing = np.zeros((90, 90), bool)
    for contrast in (200, 25):  # strong edges and weak ones
        wide = texture(rng, (90, 92), (0, 0, 0), (contrast,) * 3)[..., 0]
        one, same = (np.rint(wide[:, 1:91] + rng.normal(size=(90, 90))) for _ in range(2))
        pairs = [(one, same), (one, same + 4), (one, wide[:, 2:])]
        still, lit, moved = (
            shift_of(*(np.clip(p, 0, 255).astype(np.uint8) for p in pair), nothing)
            for pair in pairs
        )
        assert still < 0.4
        assert lit < 0.4
        assert moved > 0.5
    flat = np.full((40, 40), 90, np.uint8)
    assert shift_of(flat, flat, nothing[:40, :40]) == 0
    assert shift_of(flat, flat, ~nothing[:40, :40]) == np.inf


def test_survey_of_too_little():
    clip = disc_clip(frames=2)
    assert survey(clip.images, clip.models).plate is None
    assert survey([], []).plate is None


def test_samples_are_spread_and_increasing():
    assert sample_frames(10, 13, 25) == [10, 11, 12]
    samples = sample_frames(0, 300, SceneSettings().samples)
    assert len(samples) == 25
    assert np.diff(samples).min() >= 12
    assert sample_frames(4, 4, 5) == []


def test_hidden_region_surrounds_the_model():
    model = disc((75, 75), 30)
    hidden = hide(model, 0.1)
    assert (hidden & model).sum() == model.sum()
    assert not (hidden & ~disc((75, 75), 38)).any()
    assert not hide(np.zeros((9, 9), bool), 0.1).any()


@pytest.mark.parametrize("corner", [(0, 0), (20, 30), (38, 52)])
def test_hiding_looks_no_further_than_it_reaches(corner: tuple[int, int]) -> None:
    rng = np.random.default_rng(3)
    model = np.zeros((60, 80), bool)
    model[corner[0] : corner[0] + 22, corner[1] : corner[1] + 28] = rng.random((22, 28)) > 0.7
    rows, columns = (np.flatnonzero(model.any(axis)) for axis in (1, 0))
    size = max(np.ptp(rows), np.ptp(columns)) + 1
    for clearance in (0.0, 0.1, 0.37, 3.0):
        near = signed_distance(model) > -clearance * size
        np.testing.assert_array_equal(hide(model, clearance), near)


def _part(clip):
    return clip.images, clip.models


@pytest.mark.parametrize("size", [(30, 41), (2, 5)])
def test_squared_slope_equals_sobel(size: tuple[int, int]) -> None:
    color = np.random.default_rng(0).integers(0, 256, (*size, 3)).astype(np.uint8)
    steps = [
        cv2.Sobel(color.astype(np.float32), cv2.CV_32F, *axis, ksize=3) / 8
        for axis in ((1, 0), (0, 1))
    ]
    found = np.empty(size, np.float32)
    around = cv2.copyMakeBorder(color, 1, 1, 1, 1, cv2.BORDER_REFLECT_101)
    _background_numba.squared_slope(around, found)
    np.testing.assert_array_equal(found, np.mean(steps[0] ** 2 + steps[1] ** 2, -1))
