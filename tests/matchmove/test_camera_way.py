"""The way of a camera, from corners whose true way is known."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from staged_sightings import FOCAL, MIDDLE, RATE, Filmed, filmed

from perfcap.matchmove import CameraWay, find_way

WRONG = 0.6  # of the focal length, as it is assumed
LENS = (WRONG * FOCAL, MIDDLE, MIDDLE)


def degrees(found: CameraWay, truth: Filmed) -> NDArray[np.float64]:
    """By which each frame is turned wrongly, (F,)."""
    apart = Rotation.from_matrix(found.rotation @ truth.rotation.transpose(0, 2, 1))
    turned: NDArray[np.float64] = np.degrees(apart.magnitude())
    return turned


def centres(rotation: NDArray[np.float64], shift: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where cameras stand, (F, 3)."""
    return -np.einsum("fji,fj->fi", rotation, shift)


@pytest.mark.long
@pytest.mark.parametrize("wild", [0.0, 0.3])
def test_a_camera_that_walks_is_found_with_its_lens(wild: float) -> None:
    truth = filmed(walk=1.2, wild=wild)
    found = find_way(truth.sightings, truth.frames, LENS, RATE)
    assert found is not None and found.moves
    assert abs(np.log(found.factor * WRONG)) < 0.03
    assert abs(np.log(found.factor * WRONG)) < 3 * found.deviation
    assert degrees(found, truth).max() < 0.6
    assert np.abs(found.rotation[0] - np.eye(3)).max() < 1e-12
    assert np.abs(found.translation[0]).max() < 1e-12
    true = centres(truth.rotation, truth.translation)
    own = centres(found.rotation, found.translation)
    scale = (own * true).sum() / (own * own).sum()
    assert scale > 0.5
    assert np.linalg.norm(scale * own - true, axis=1).max() < 0.06
    assert found.explained > 0.9 - wild


def test_a_camera_on_a_tripod_only_turns() -> None:
    truth = filmed()
    found = find_way(truth.sightings, truth.frames, LENS, RATE)
    assert found is not None and not found.moves
    assert np.array_equal(found.translation, np.zeros((truth.frames, 3)))
    assert abs(np.log(found.factor * WRONG)) < 0.05
    assert degrees(found, truth).max() < 0.6


@pytest.mark.long
def test_a_known_lens_stays() -> None:
    truth = filmed(walk=1.0)
    lens = (FOCAL, MIDDLE, MIDDLE)
    found = find_way(truth.sightings, truth.frames, lens, RATE, guessed=False)
    assert found is not None and found.factor == 1.0 and found.deviation == 0.0
    assert degrees(found, truth).max() < 0.6


@pytest.mark.long
def test_shrunk_images_are_seen_by_the_same_camera() -> None:
    truth = filmed(walk=1.0)
    whole = find_way(truth.sightings, truth.frames, LENS, RATE)
    half = replace(truth.sightings, pixels=0.5 * (truth.sightings.pixels + 0.5) - 0.5, scale=0.5)
    found = find_way(half, truth.frames, LENS, RATE)
    assert whole is not None and found is not None
    assert abs(found.factor - whole.factor) < 0.02
    assert np.abs(found.rotation - whole.rotation).max() < 0.01


def test_frames_between_key_frames_follow_their_own_sightings() -> None:
    truth = filmed(frames=40, noise=0.02)
    jolt = Rotation.from_rotvec([0.0, 0.02, 0.0]).as_matrix()
    rotation = truth.rotation.copy()
    rotation[14] = jolt @ rotation[14]  # key frames are 0, 3, 6, ...
    here = truth.sightings.frame == 14
    rays = np.column_stack(((truth.sightings.pixels[here] - MIDDLE) / FOCAL, np.ones(here.sum())))
    moved = rays @ jolt.T
    pixels = truth.sightings.pixels.copy()
    pixels[here] = FOCAL * moved[:, :2] / moved[:, 2:] + MIDDLE
    shaken = replace(truth, rotation=rotation, sightings=replace(truth.sightings, pixels=pixels))
    found = find_way(shaken.sightings, truth.frames, (FOCAL, MIDDLE, MIDDLE), RATE, guessed=False)
    assert found is not None
    assert degrees(found, shaken)[14] < 0.2  # of 1.1


@pytest.mark.long
def test_the_same_sightings_give_the_same_bits() -> None:
    truth = filmed(walk=0.5, wild=0.2)
    one, two = (find_way(truth.sightings, truth.frames, LENS, RATE) for _ in range(2))
    assert one is not None and two is not None
    assert np.array_equal(one.rotation, two.rotation)
    assert np.array_equal(one.translation, two.translation)


@pytest.mark.long
def test_too_little_shows_nothing() -> None:
    truth = filmed(points=8)
    assert find_way(truth.sightings, truth.frames, LENS, RATE) is None
    short = filmed(frames=3)
    assert find_way(short.sightings, 3, LENS, RATE) is None
    cut = filmed()
    other = replace(cut.sightings, point=cut.sightings.point + 1000 * (cut.sightings.frame > 30))
    assert find_way(other, cut.frames, LENS, RATE) is None
    noise = np.random.default_rng(0).uniform(0, 640, cut.sightings.pixels.shape)
    assert find_way(replace(cut.sightings, pixels=noise), cut.frames, LENS, RATE) is None


@pytest.mark.long
def test_a_frame_that_fits_no_other_has_no_way() -> None:
    """It ended in the linear algebra: nothing was left to turn this frame by."""
    truth = filmed(walk=1.2, points=400)
    seen = truth.sightings
    short = np.bincount(seen.point)[seen.point] < 20  # else one sighting that is off is pardoned
    pixels = seen.pixels.copy()
    astray = seen.frame == 9
    pixels[astray] = np.random.default_rng(1).permutation(pixels[astray]) + 200
    shaken = replace(seen, pixels=pixels).part(short)
    assert find_way(shaken, truth.frames, LENS, RATE) is None
