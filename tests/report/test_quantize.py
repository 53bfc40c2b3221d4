"""Sixteen bits a coordinate: how far off, and whether differences add up again."""

import zlib

import numpy as np
import pytest

from perfcap.report.model import STEP, Box, difference, restore


def walk(frames: int = 20, vertices: int = 50, reach: float = 1.0) -> np.ndarray:
    """A cloud of points that moves along, metres."""
    random = np.random.default_rng(0)
    rest = random.uniform(-1, 1, (vertices, 3))
    path = reach * np.linspace(0, 1, frames)[:, None, None] * np.array([1.0, 0.1, -0.5])
    return rest + path + 0.01 * random.normal(size=(frames, vertices, 3))


@pytest.mark.parametrize(("reach", "step"), [(1.0, STEP), (20.0, None)])
def test_positions_are_off_by_half_a_step(reach: float, step: float | None) -> None:
    points = walk(reach=reach)
    low, high = points.min((0, 1)), points.max((0, 1))
    box = Box.around(low, high)
    assert box.step == pytest.approx(step or (high - low).max() / 65535)
    back = box.positions(restore(difference(box.levels(points))))
    assert np.abs(back - points).max() <= 0.5 * box.step * (1 + 1e-9)


def test_any_levels_come_back() -> None:
    """Jumps from one end to the other wrap around, and back."""
    levels = np.random.default_rng(1).integers(0, 65536, (5, 7, 3)).astype(np.uint16)
    levels[0, 0], levels[1, 0], levels[2, 0] = 0, 65535, 0
    np.testing.assert_array_equal(restore(difference(levels)), levels)
    single = levels[:1, :1]
    np.testing.assert_array_equal(restore(difference(single)), single)


def test_motion_together_takes_little_room() -> None:
    points = walk(60, 400)
    rest = points.mean(0) + np.linspace(0, 1, 60)[:, None, None]
    box = Box.around(rest.min((0, 1)), rest.max((0, 1)))
    levels = box.levels(rest)
    assert len(zlib.compress(difference(levels).tobytes(), 9)) < 0.1 * levels.nbytes
