"""Bundle adjustment: derivatives, and what is known of a lens."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from staged_sightings import FOCAL, MIDDLE, filmed

from perfcap.matchmove.bundle import Bundle, Prior, Problem, linearized

LENS = (FOCAL, MIDDLE, MIDDLE)


def problem(noise: float = 0.2, seed: int = 0) -> tuple[Problem, Bundle]:
    """A few frames near the truth."""
    truth = filmed(frames=8, turn=6, walk=0.4, noise=noise, seed=seed)
    names, point = np.unique(truth.sightings.point, return_inverse=True)
    seen = replace(truth.sightings, point=point)
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(len(names), 3)) * [0.2, 0.2, 0.1] + [0, 0, 1]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    near = rng.uniform(0.1, 0.4, len(names))
    bundle = Bundle(truth.rotation, truth.translation, direction, near, 0.1)
    return Problem(seen, LENS, 0.1, bundle, Prior(), 1.5, moves=True), bundle


def nudged(bundle: Bundle, camera: NDArray[np.float64], point: NDArray[np.float64]) -> Bundle:
    """All cameras moved by the same seven numbers, all points by three."""
    tangents = linearized(problem()[0], bundle)[2]
    direction = bundle.direction + tangents @ point[:2]
    return Bundle(
        Rotation.from_rotvec(camera[:3]).as_matrix() @ bundle.rotation,
        bundle.translation + camera[3:6],
        direction / np.linalg.norm(direction, axis=1, keepdims=True),
        bundle.nearness + point[2],
        bundle.log_focal + camera[6],
    )


@pytest.mark.parametrize("unknown", range(10))
def test_derivatives_are_those_of_finite_differences(unknown: int) -> None:
    given, bundle = problem()
    cameras, points, _ = linearized(given, bundle)
    step = np.zeros(10)
    step[unknown] = 1e-6
    ahead, behind = (
        given.errors(nudged(bundle, sign * step[:7], sign * step[7:]))[1] for sign in (1, -1)
    )
    found = (ahead - behind) / 2e-6
    own = np.concatenate((cameras, points), -1)[..., unknown]
    assert np.abs(own).max() > 0.1
    assert np.abs(found - own).max() < 1e-4 * max(1.0, np.abs(own).max())


def test_less_noise_tells_more_of_the_lens() -> None:
    deviations = [problem(noise, seed=3)[0].solve().deviation for noise in (0.1, 0.8)]
    assert 0 < deviations[0] < deviations[1] < 0.35


def test_noise_is_that_of_the_sightings() -> None:
    found = problem(0.3)[0].solve()
    # eight frames have few sightings a point, and some of the noise is fitted
    assert 0.1 < found.noise < 0.35
    assert math.isfinite(found.cost)
