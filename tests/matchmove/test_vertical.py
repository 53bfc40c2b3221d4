"""Up, from drawn rooms whose cameras are known."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from perfcap.matchmove import Sight, find_vertical

Array = NDArray[np.float64]

SIZE, FOCAL = (480, 640), 520.0
LENS = (FOCAL, 319.5, 239.5)
UP = np.array([0.0, -1.0, 0.0])


def camera(pitch: float, roll: float) -> Array:
    """World to camera: looks down by a pitch, then rolls, degrees."""
    turns = Rotation.from_euler("zx", [roll, pitch], degrees=True)
    return np.asarray(turns.as_matrix().T)


def room(
    rotation: Array, posts: int = 9, slanted: int = 14, seed: int = 0, spread: float = 2.5
) -> NDArray[np.uint8]:
    """Upright posts, and as many poles that lean anyhow."""
    rng = np.random.default_rng(seed)
    image = np.full((*SIZE, 3), 200, np.uint8)
    image += rng.integers(0, 5, image.shape, dtype=np.uint8)
    places = np.linspace(-spread, spread, posts)
    lines = [([place, -1.4, 4.0], [place, 1.2, 4.0]) for place in places]
    for _ in range(slanted):
        middle = rng.uniform([-2.5, -1.2, 4], [2.5, 1.2, 5])
        lean = rng.normal(size=3)
        lean *= 0.3 / np.linalg.norm(lean)
        lines.append((middle - lean, middle + lean))
    for one, two in lines:
        ends = np.array([one, two]) @ rotation.T
        pixels = np.rint(FOCAL * ends[:, :2] / ends[:, 2:] + LENS[1:]).astype(int)
        cv2.line(image, pixels[0].tolist(), pixels[1].tolist(), (40, 60, 50), 4, cv2.LINE_AA)
    return image


def sight(rotation: Array, image: NDArray[np.uint8], seen_by: Array | None = None) -> Sight:
    turn = np.eye(3) if seen_by is None else seen_by
    return Sight(image, np.zeros(SIZE, np.bool_), LENS, turn)


def degrees(one: Array, two: Array) -> float:
    return float(np.degrees(np.arccos(np.clip(one @ two, -1, 1))))


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (12.0, 0.0), (8.0, 6.0), (-10.0, -8.0)])
def test_upright_posts_show_it(pitch: float, roll: float) -> None:
    rotation = camera(pitch, roll)
    true = rotation @ UP
    assert degrees(true, UP) == pytest.approx(np.hypot(pitch, roll), abs=0.5)
    found = find_vertical([sight(rotation, room(rotation))], UP)
    assert found is not None and degrees(found, true) < 0.6


def test_a_shrunk_image_and_frames_of_a_camera_that_turns() -> None:
    """In the world of the first frame."""
    first = camera(10.0, 0.0)
    turned = Rotation.from_euler("y", 8, degrees=True).as_matrix() @ first
    large = cv2.resize(room(first), None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    lens = (3 * FOCAL, 3 * 319.5 + 1, 3 * 239.5 + 1)
    whole = np.zeros(large.shape[:2], np.bool_)
    sights = [
        Sight(np.asarray(large, np.uint8), whole, lens, np.eye(3)),
        sight(turned, room(turned), turned @ first.T),
    ]
    found = find_vertical(sights, UP)
    assert found is not None and degrees(found, first @ UP) < 0.6


@pytest.mark.parametrize("degrees_off", [-12, -8, 8, 12])
def test_it_does_not_matter_where_the_search_starts(degrees_off: float) -> None:
    """Poles that lean to one side are no more usual about one start than about another."""
    image = room(np.eye(3), posts=6, slanted=0)
    rng = np.random.default_rng(0)
    for lean in np.radians(rng.uniform(10, 34, 45)):
        middle, half = (
            rng.uniform([60, 60], [580, 420]),
            45 * np.array([np.sin(lean), -np.cos(lean)]),
        )
        one, two = np.rint([middle - half, middle + half]).astype(int).tolist()
        cv2.line(image, one, two, (40, 60, 50), 4, cv2.LINE_AA)
    off = np.radians(degrees_off)
    found = find_vertical([sight(np.eye(3), image)], np.array([np.sin(off), -np.cos(off), 0.0]))
    assert found is not None and degrees(found, UP) < 0.6


def test_what_shows_nothing() -> None:
    """No edges, edges all over, one post, posts where a person may be, a start far away."""
    rotation = camera(10.0, 0.0)
    posts = sight(rotation, room(rotation))
    assert find_vertical([sight(rotation, np.full((*SIZE, 3), 90, np.uint8))], UP) is None
    assert find_vertical([sight(rotation, room(rotation, posts=0, slanted=60))], UP) is None
    assert find_vertical([sight(rotation, room(rotation, posts=1, slanted=0))], UP) is None
    assert find_vertical([replace(posts, hidden=~posts.hidden)], UP) is None
    aside = np.array([1.0, 0.0, 0.0])
    assert find_vertical([sight(rotation, room(rotation, slanted=0))], aside) is None
    assert find_vertical([], UP) is None
