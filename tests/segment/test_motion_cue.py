"""Temporal gradients, scene changes and moving cameras."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from disc_scene import disc, disc_clip, texture

from perfcap.segment.motion_cue import MotionSettings, find_cuts, temporal_gradient
from perfcap.segment.registration import (
    RegistrationSettings,
    find_landmarks,
    register,
    resample,
)

SETTINGS = MotionSettings()


def test_moving_pixels_stand_out_and_uncovered_ground_does_not():
    clip = disc_clip(frames=5, speed=6.0)
    image, before, after = (clip.images[i].astype(np.float32) for i in (2, 1, 3))
    around = ~disc((75, 77), 60)
    cue = temporal_gradient(image, [before, after], around, SETTINGS)
    assert cue.gradient is not None
    assert np.median(cue.gradient[clip.truth[2]]) > 1
    uncovered = clip.truth[1] & ~clip.truth[2]
    assert np.median(cue.gradient[uncovered]) < 0.7
    assert np.median(cue.gradient[around]) < 0.7


def test_cue_is_off_without_neighbours_and_where_everything_moves():
    clip = disc_clip(frames=3, pan=7.0)
    image, before = (clip.images[i].astype(np.float32) for i in (1, 0))
    around = ~disc((75, 77), 50)
    assert temporal_gradient(image, [], around, SETTINGS).gradient is None
    cue = temporal_gradient(image, [before], around, MotionSettings(unsteady=6.0))
    assert cue.gradient is None
    assert cue.level > 6


def test_cut_is_told_from_camera_and_light():
    clip, other = disc_clip(frames=3, pan=12.0), disc_clip(
        frames=1, seed=7, scene=((180, 20, 60), (250, 80, 200)), person=((0, 200, 0), (9, 255, 30))
    )  # fmt: skip
    image = clip.images[0]
    assert not find_cuts([image, image])
    assert not find_cuts([image, clip.images[1]])
    assert not find_cuts([image, (image * 0.6).astype(np.uint8)])
    noise = np.random.default_rng(0).integers(0, 256, (5, 5, 3)).astype(np.uint8)
    scene = cv2.resize(noise, (150, 150), interpolation=cv2.INTER_NEAREST)
    assert find_cuts([other.images[0], scene]) == {1}
    assert find_cuts([scene, other.images[0]]) == {1}


@pytest.mark.parametrize("size", [200, 900])
def test_registration_recovers_a_homography(size):
    rng = np.random.default_rng(2)
    image = texture(rng, (size, size), (0, 0, 0), (255, 255, 255), size / 70).astype(np.uint8)
    scale = size / 200
    truth = np.array([[1.01, 0.02, 3 * scale], [-0.015, 0.99, -2 * scale], [1e-5 / scale, 0, 1]])
    other = cv2.warpPerspective(image, truth, (size, size), borderMode=cv2.BORDER_REFLECT)
    landmarks = find_landmarks(image, disc((99 * scale, 99 * scale), 30, (size, size)), SMALL)
    found = register(landmarks, other, SMALL)
    corners = np.array([[[20, 20], [180, 30], [150, 170], [30, 160]]]) * scale
    error = cv2.perspectiveTransform(corners, found) - cv2.perspectiveTransform(corners, truth)
    assert np.abs(error).max() < 0.4 * scale
    box = (slice(20, size - 20), slice(30, size - 30))
    part, inside = resample(other, found, box)
    assert inside[20:-20, 20:-20].all()
    assert np.abs(part.astype(float) - image[box])[20:-20, 20:-20].mean() < 4


SMALL = RegistrationSettings(side=400)


def test_registration_gives_up_without_texture_or_agreement():
    flat = np.full((80, 80, 3), 90, np.uint8)
    landmarks = find_landmarks(flat, np.zeros((80, 80), bool), SMALL)
    assert register(landmarks, flat, SMALL) is None
    rng = np.random.default_rng(3)
    one, other = (rng.integers(0, 256, (120, 120, 3)).astype(np.uint8) for _ in range(2))
    landmarks = find_landmarks(one, np.zeros((120, 120), bool), SMALL)
    assert register(landmarks, other, SMALL) is None
