"""How wide a part is whose far side lies in front of another part."""

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.render.part_depth import part_depth

# an arm (1) of 12 px in front of a torso (0), which background (-1) ends on the right
PARTS = np.full((40, 60), -1)
PARTS[:, 10:22] = 1
PARTS[:, 22:50] = 0
LEFT, RIGHT = np.array([[-1.0, 0.0]]), np.array([[1.0, 0.0]])


def test_an_arm_ends_where_the_torso_begins() -> None:
    found = part_depth(np.array([[9.5, 20.0]]), LEFT, PARTS, 30)
    assert found == pytest.approx(12, abs=1)


def test_seen_across_at_an_angle_it_is_wider() -> None:
    normal = np.array([[-(0.5**0.5), -(0.5**0.5)]])
    found = part_depth(np.array([[9.5, 10.0]]), normal, PARTS, 30)
    assert found == pytest.approx(12 * 2**0.5, abs=1.5)


def test_background_and_reach_are_no_other_part() -> None:
    torso = part_depth(np.array([[49.5, 20.0]]), RIGHT, PARTS, 20)
    alone = part_depth(np.array([[9.5, 20.0]]), LEFT, np.where(PARTS == 1, 1, -1), 30)
    assert np.isinf(torso) and np.isinf(alone)


def test_points_that_see_nothing_inward() -> None:
    outside = np.array([[-5.0, 20.0], [200.0, 3.0], [5.0, 20.0]])
    normals = np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0]])
    assert np.isinf(part_depth(outside, normals, PARTS, 30)).all()
    assert part_depth(np.zeros((0, 2)), np.zeros((0, 2)), PARTS, 30).shape == (0,)


def test_parts_of_a_piece_of_the_image() -> None:
    points = np.array([[9.5, 20.0], [12.0, 4.0], [49.5, 20.0]])
    normals = np.concatenate([LEFT, LEFT, RIGHT])
    whole = part_depth(points, normals, PARTS, 45)
    piece = part_depth(points, normals, PARTS[1:38, 8:55], 45, (1, 8))
    assert np.isfinite(whole).any()
    np.testing.assert_array_equal(piece, whole)


def test_parts_may_be_those_of_triangles() -> None:
    points, normals = np.array([[9.5, 20.0], [49.5, 20.0]]), np.concatenate([LEFT, RIGHT])
    of_triangle = np.array([1, 0, 1])
    triangle = np.select([PARTS == 1, PARTS == 0], [2, 1], -1).astype(np.int32)
    found = part_depth(points, normals, triangle, 45, of_triangle=of_triangle)
    np.testing.assert_array_equal(found, part_depth(points, normals, PARTS, 45))
    with pytest.raises(InputError, match="triangle 2 but of_triangle has 2"):
        part_depth(points, normals, triangle, 45, of_triangle=of_triangle[:2])


def test_the_compiled_loop_equals_numpy() -> None:
    rng = np.random.default_rng(0)
    parts = np.kron(rng.integers(-1, 3, (9, 11)), np.ones((7, 6), np.int64))
    points = rng.uniform(-9, 75, (400, 2))
    turn = rng.uniform(0, 2 * np.pi, 400)
    normals = np.stack([np.cos(turn), np.sin(turn)], 1)
    for reach, corner in ((0.0, (0, 0)), (12.0, (3, 5)), (40.0, (0, 0))):
        steps = np.arange(1.5, max(reach, 1.5) + 1.0)
        at = points[:, None] - steps[:, None] * normals[:, None]
        column, row = np.rint(at).astype(int).transpose(2, 0, 1)
        row, column = row - corner[0], column - corner[1]
        inside = (row >= 0) & (row < len(parts)) & (column >= 0) & (column < parts.shape[1])
        seen = np.where(inside, parts[row.clip(0, 62), column.clip(0, 65)], -1)
        other = seen != seen[:, :1]
        first = other.argmax(1)
        ends = other.any(1) & (seen[:, 0] >= 0) & (seen[np.arange(400), first] >= 0)
        expected = np.where(ends, steps[first], np.inf)
        np.testing.assert_array_equal(part_depth(points, normals, parts, reach, corner), expected)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((5, 2))}, "normals has shape"),
        ({"points": np.zeros((1, 1))}, "points has shape"),
        ({"parts": PARTS[None]}, "parts has shape"),
        ({"reach": np.inf}, "reach is inf"),
    ],
)
def test_what_does_not_fit_is_refused(change, message) -> None:
    """Compiled loops read beyond the end of arrays."""
    given = {"points": np.zeros((1, 2)), "normals": LEFT, "parts": PARTS, "reach": 30.0} | change
    with pytest.raises(InputError, match=message):
        part_depth(**given)
