"""The ground among points, whose plane is known."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from perfcap.matchmove import GroundSettings, find_ground

Array = NDArray[np.float64]
LOOSE = np.radians(6)
UP = np.array([0.0, -1.0, 0.0])
TURN = Rotation.from_euler("zx", [4.0, 9.0], degrees=True)


def scene(floor: int = 120, wall: int = 80, wide: float = 3.0, seed: int = 0) -> Array:
    """Points of a floor 1.5 below the camera and of a wall, off by half a percent of their way."""
    rng = np.random.default_rng(seed)
    ground = np.stack(
        (rng.uniform(-wide, wide, floor), np.full(floor, 1.5), rng.uniform(3, 8, floor)), -1
    )
    behind = np.stack(
        (rng.uniform(-3, 3, wall), rng.uniform(-2, 1.5, wall), np.full(wall, 8.0)), -1
    )
    points = np.concatenate((ground, behind))
    points += 0.005 * np.linalg.norm(points, axis=1)[:, None] * rng.normal(size=points.shape)
    return np.asarray(TURN.apply(points))


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_the_floor_is_found_in_any_unit(scale: float) -> None:
    found = find_ground(scale * scene(), UP, LOOSE)
    assert found is not None
    assert np.degrees(np.arccos(found.normal @ TURN.apply(UP))) < 0.5
    assert found.height == pytest.approx(-1.5 * scale, rel=0.03)
    again = find_ground(scale * scene(), UP, LOOSE)
    assert again is not None and np.array_equal(again.normal, found.normal)


def test_what_is_no_ground() -> None:
    """A wall, a ceiling, few points, a strip, another direction, points anywhere."""
    assert find_ground(scene(floor=0), UP, LOOSE) is None
    assert find_ground(scene() * [1, -1, 1], UP, LOOSE) is None
    assert find_ground(scene(floor=12, wall=0), UP, LOOSE) is None
    assert find_ground(scene(floor=12), UP, LOOSE) is None
    assert find_ground(scene(wide=0.02, wall=0), UP, LOOSE) is None
    assert find_ground(scene(), np.array([1.0, 0.0, 0.0]), LOOSE) is None
    cloud = np.random.default_rng(0).uniform(-3, 3, (200, 3))
    assert find_ground(cloud, UP, LOOSE, GroundSettings(share=0.3)) is None


def test_points_far_away_leave_the_tilt_to_what_is_known() -> None:
    """All seen under nearly the same angle: a tilt of the plane is a height at the camera."""
    rng = np.random.default_rng(1)
    far = np.stack((rng.uniform(-2, 2, 60), np.full(60, 1.5), rng.uniform(8.5, 11, 60)), -1)
    points = TURN.apply(far * (1 + 0.03 * rng.normal(size=(60, 1))))
    true = np.asarray(TURN.apply(UP))
    off = [
        abs(ground.height + 1.5)
        for deviation in (np.radians(0.5), np.radians(20))
        if (
            ground := find_ground(points, true, deviation, GroundSettings(within=0.03, spread=0.01))
        )
    ]
    assert len(off) == 2 and off[0] < 0.1 and off[0] < off[1]
