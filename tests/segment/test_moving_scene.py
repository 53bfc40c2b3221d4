"""The background of a moving camera: planes, parallax, exposure, cuts."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from disc_scene import disc, texture

from perfcap.segment.alignment import AlignmentSettings, find_shifts, match_exposure
from perfcap.segment.background import PlateSettings
from perfcap.segment.moving_scene import MovingSettings, Samples
from perfcap.segment.scene import hide, survey

SIZE = 240
PLATE = PlateSettings(least=1)


def floor_and_wall(frames=11, parallax=1.5, gain=0.0, seed=0):
    """Images, people, and the scene without them, (F, ...), of a camera that is carried.

    The wall, above, moves to the right and the floor, below, ``1 + parallax`` times as far in its
    nearest row; where they meet they move alike, as planes do.
    """
    rng = np.random.default_rng(seed)
    wall, floor = (
        texture(rng, (SIZE, 2 * SIZE), (40, 60, 40), (220, 190, 200), grain=1.5) for _ in range(2)
    )
    rows, columns = np.mgrid[:SIZE, :SIZE].astype(np.float32)
    below = np.clip((rows - SIZE / 2) / (SIZE / 2), 0, None)
    images, people, scenes = [], [], []
    for frame in range(frames):
        shift = 3.0 * (frame - frames // 2)
        at = columns + SIZE / 2 - shift * (1 + parallax * below)
        parts = (cv2.remap(p, at, rows, cv2.INTER_LINEAR) for p in (wall, floor))
        scene = np.where(below[..., None] > 0, *reversed(list(parts)))
        scene = scene * (1 + gain * (frame - frames // 2) / frames)
        person = disc((SIZE / 2 + 16 * (frame - frames // 2), SIZE / 2 + 30), 24, (SIZE, SIZE))
        image = np.where(person[..., None], rng.uniform(0, 255, scene.shape), scene)
        image += rng.normal(scale=1.5, size=image.shape)
        images.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
        people.append(person)
        scenes.append(scene)
    return np.array(images), np.array(people), np.array(scenes)


def behind(key, scene, person):
    """Error of a plate behind a person, median and 90th percentile, grey levels."""
    rows, columns = key.region
    shown = key.plate.known & person[rows, columns]
    apart = np.abs(key.plate.color.astype(float) - scene[rows, columns]).mean(-1)[shown]
    return shown.sum() / person[rows, columns].sum(), np.median(apart), np.quantile(apart, 0.9)


@pytest.mark.long
@pytest.mark.parametrize("gain", [0.0, 0.3])
def test_floor_and_wall_are_found_behind_the_person(gain):
    images, people, scenes = floor_and_wall(gain=gain)
    scene = survey(images, people)
    assert scene.plate is None and scene.shift > 0.5
    hidden = [hide(person, 0.05) for person in people]
    region = slice(20, 230), slice(30, 210)
    key = scene.samples.key_frame(images[5], hidden[5], region, PLATE)
    share, median, most = behind(key, scenes[5], people[5])
    assert share > 0.95
    assert median < 4
    assert most < 12

    part = slice(90, 200), slice(60, 190)
    plate = key.seen_from(images[6], hidden[6], part)
    seen = plate.known & people[6][part]
    apart = np.abs(
        plate.color[seen].astype(float)
        - scenes[6][part][seen] * images[5].mean() / images[6].mean()
    )
    assert seen.sum() > 0.9 * people[6][part].sum()
    assert np.median(apart) < 6


@pytest.mark.long
def test_one_homography_would_not_do():
    images, people, scenes = floor_and_wall()
    hidden = [hide(person, 0.05) for person in people]
    whole = slice(0, SIZE), slice(0, SIZE)
    settings = MovingSettings()
    flat = replace(settings, layers=replace(settings.layers, planes=1))
    errors = [
        behind(
            Samples.of(images, hidden, s).key_frame(images[5], hidden[5], whole, PLATE),
            scenes[5],
            people[5],
        )[2]
        for s in (flat, settings)
    ]
    assert errors[1] < errors[0]


@pytest.mark.long
def test_samples_of_another_shot_are_left_out():
    images, people, scenes = floor_and_wall()
    others, strangers, _ = floor_and_wall(seed=7)
    hidden = [hide(person, 0.05) for person in (*people, *strangers)]
    whole = slice(0, SIZE), slice(0, SIZE)
    both = Samples.of([*images, *others], hidden).key_frame(images[5], hidden[5], whole, PLATE)
    _, median, most = behind(both, scenes[5], people[5])
    assert median < 4
    assert most < 12


def test_flat_pictures_have_no_plate():
    flat = np.full((5, 60, 60, 3), 90, np.uint8)
    nobody = np.zeros((5, 60, 60), np.bool_)
    samples = Samples.of(flat, nobody)
    assert samples.key_frame(flat[2], nobody[2], (slice(0, 60), slice(0, 60)), PLATE) is None


def test_shifts_are_found_and_carried_behind_the_person():
    rng = np.random.default_rng(0)
    source = texture(rng, (200, 200), (20, 20, 20), (230, 230, 230), grain=2).astype(np.uint8)
    rows, columns = np.mgrid[:200, :200].astype(np.float32)
    truth = 2.5 * rows / 200
    target = cv2.remap(source, columns + truth, rows, cv2.INTER_LINEAR)
    person = disc((100, 100), 30, (200, 200))
    target[person] = rng.integers(0, 255, (person.sum(), 3))
    shifts = find_shifts(target, source, ~person, AlignmentSettings())
    inner = slice(20, 180), slice(20, 180)
    apart = np.abs(shifts - np.stack((truth, 0 * truth), -1)).max(-1)
    assert np.median(apart[inner]) < 0.2
    assert np.quantile(apart[inner], 0.95) < 0.5
    assert apart[person].max() < 0.9


def test_nothing_to_shift_and_nothing_to_see():
    picture = texture(np.random.default_rng(1), (80, 80), (20, 20, 20), (230, 230, 230))
    picture = picture.astype(np.uint8)
    everywhere = np.ones((80, 80), np.bool_)
    assert find_shifts(picture, picture, everywhere, AlignmentSettings()) is None
    assert find_shifts(picture, picture, ~everywhere, AlignmentSettings()) is None


def test_exposure_is_matched_channel_by_channel():
    rng = np.random.default_rng(2)
    source = rng.integers(20, 150, (60, 60, 3)).astype(np.uint8)
    gains = np.array([1.3, 0.8, 1.0])
    target = np.clip(np.rint(source * gains), 0, 255).astype(np.uint8)
    visible = np.ones((60, 60), np.bool_)
    matched = match_exposure(target, source, visible)
    assert np.abs(matched.astype(int) - target).max() <= 1
    np.testing.assert_array_equal(match_exposure(target, source, ~visible), source)


def lamp(images):
    """Switched on."""
    images[7:] = np.clip(images[7:] * 1.15 + 5, 0, 255)


def black(images):
    """One frame, in the middle of one side."""
    images[2] = 0


def passer_by(images):
    """Whom nothing models."""
    rng = np.random.default_rng(3)
    for frame, image in enumerate(images):
        left = 10 + 15 * frame
        image[130:200, left : left + 18] = rng.integers(0, 255, (70, 18, 3))


@pytest.mark.long
@pytest.mark.parametrize(("spoil", "most"), [(lamp, 5.0), (black, 3.0), (passer_by, 7.0)])
def test_what_happens_in_a_clip(spoil, most):
    images, people, scenes = floor_and_wall()
    spoil(images)
    hidden = [hide(person, 0.05) for person in people]
    whole = slice(0, SIZE), slice(0, SIZE)
    key = Samples.of(images, hidden).key_frame(images[5], hidden[5], whole, PLATE)
    share, median, _ = behind(key, scenes[5], people[5])
    assert share > 0.95
    assert median < most


def test_five_frames_are_enough_and_two_are_not():
    images, people, scenes = floor_and_wall(frames=5)
    scene = survey(images, people)
    hidden = [hide(person, 0.05) for person in people]
    whole = slice(0, SIZE), slice(0, SIZE)
    key = scene.samples.key_frame(images[2], hidden[2], whole, PLATE)
    apart = np.abs(key.plate.color.astype(float) - scenes[2]).mean(-1)[key.plate.known]
    assert np.median(apart) < 4
    assert survey(images[:2], people[:2]).samples is None
