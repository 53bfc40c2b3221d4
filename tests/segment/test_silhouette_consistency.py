"""Coverage of silhouettes against pictures that are drawn and looked through."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from perfcap.segment.silhouette_consistency import MISSED, CoarseSilhouette, Coverage

HEIGHT, WIDTH = 60, 80
WHOLE = (slice(0, HEIGHT), slice(0, WIDTH))
FACES = np.array([[0, 2, 1], [2, 3, 1]])  # a quadrilateral, seen from outside
ALL = np.ones(4, np.bool_)
SEEN = np.ones(2, np.bool_)


def disc(column: float, row: float, radius: float) -> NDArray[np.bool_]:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.hypot(columns - column, rows - row) < radius


def box(left: float, top: float, right: float, bottom: float) -> NDArray[np.float64]:
    return np.array([[left, right, left, right], [top, top, bottom, bottom]], float)


def looked_through(
    mask: NDArray[np.bool_], picture: NDArray[np.bool_], seen: NDArray[np.bool_], unit: float
) -> float:
    """The definition, pixel after pixel."""
    distance = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    missed = (mask & ~picture).sum() / mask.sum()
    return float(MISSED * missed + (distance * seen).sum() / max(seen.sum(), 1) / unit)


def drawn(corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    (left, right), (top, bottom) = corners[0, [0, 3]], corners[1, [0, 3]]
    return (columns >= left) & (columns <= right) & (rows >= top) & (rows <= bottom)


@pytest.mark.parametrize("unit", [1.0, 0.5])
def test_equals_the_definition(unit: float) -> None:
    mask = disc(40, 30, 14.5)
    silhouette = CoarseSilhouette.of(mask, WHOLE, 1.0, unit)
    nothing = Coverage.of(silhouette, box(0, 0, 1, 1), ALL, FACES[:0], SEEN[:0])
    poses = np.stack([box(30, 20, 50, 44), box(5, 5, 20, 20), box(60, 25, 95, 90)], 1)
    found = nothing.costs(poses, np.ones((3, 4), np.bool_), FACES, SEEN)
    for pose, cost in zip(poses.swapaxes(0, 1), found, strict=True):
        picture = drawn(pose)
        assert cost == pytest.approx(looked_through(mask, picture, picture, unit), rel=1e-6)


def test_what_stays_and_what_moves_are_one_picture() -> None:
    mask = disc(40, 30, 14.5)
    silhouette = CoarseSilhouette.of(mask, WHOLE, 1.0, 1.0)
    still, moving = box(25, 20, 45, 40), box(40, 25, 70, 35)
    base = Coverage.of(silhouette, still, ALL, FACES, SEEN)
    (found,) = base.costs(moving[:, None], ALL[None], FACES, SEEN)
    picture = drawn(still) | drawn(moving)
    assert found == pytest.approx(looked_through(mask, picture, picture, 1.0), rel=1e-6)
    again = base.costs(moving[:, None], ALL[None], FACES, SEEN)
    assert again == found  # the picture is as it was


def test_what_was_hidden_may_be_anywhere_but_covers() -> None:
    mask = disc(40, 30, 14.5)
    silhouette = CoarseSilhouette.of(mask, WHOLE, 1.0, 1.0)
    base = Coverage.of(silhouette, box(0, 0, 1, 1), ALL, FACES[:0], SEEN[:0])
    pose = box(30, 20, 75, 44)
    (found,) = base.costs(pose[:, None], ALL[None], FACES, ~SEEN)
    assert found == pytest.approx(looked_through(mask, drawn(pose), np.zeros_like(mask), 1.0))


def test_behind_the_camera_nothing_is_covered() -> None:
    silhouette = CoarseSilhouette.of(disc(40, 30, 14.5), WHOLE, 1.0, 1.0)
    base = Coverage.of(silhouette, box(0, 0, 1, 1), ALL, FACES[:0], SEEN[:0])
    hidden = ALL.copy()
    hidden[1] = False
    assert base.costs(box(30, 20, 50, 44)[:, None], hidden[None], FACES, SEEN) == MISSED


def test_coarse_pixels_cost_about_the_same() -> None:
    mask = disc(40, 30, 14.5)
    pose = box(33, 22, 62, 41)[:, None]
    costs = []
    for scale in (1.0, 2.0, 3.0):
        silhouette = CoarseSilhouette.of(mask, (slice(4, 60), slice(8, 80)), scale, 1.0)
        base = Coverage.of(silhouette, box(0, 0, 1, 1), ALL, FACES[:0], SEEN[:0])
        costs += base.costs(pose, ALL[None], FACES, SEEN).tolist()
    assert costs == pytest.approx([costs[0]] * 3, rel=0.1)


def test_an_empty_silhouette_is_no_place_to_be() -> None:
    silhouette = CoarseSilhouette.of(np.zeros((HEIGHT, WIDTH), np.bool_), WHOLE, 2.0, 1.0)
    base = Coverage.of(silhouette, box(0, 0, 1, 1), ALL, FACES[:0], SEEN[:0])
    outside, far = base.costs(
        np.stack([box(33, 22, 62, 41), box(200, 200, 210, 210)], 1),
        np.ones((2, 4), np.bool_), FACES, SEEN,
    )  # fmt: skip
    assert far == 0
    assert outside == pytest.approx(np.hypot(HEIGHT, WIDTH), rel=0.1)


def test_what_is_seen_from_inside_covers_nothing() -> None:
    """Of a closed surface it covers nothing that its other side does not."""
    silhouette = CoarseSilhouette.of(disc(40, 30, 14.5), WHOLE, 1.0, 1.0)
    base = Coverage.of(silhouette, box(0, 0, 1, 1), ALL, FACES[:0], SEEN[:0])
    pose, one = box(30, 20, 50, 44)[:, None], ALL[None]
    assert base.costs(pose, one, FACES[:, ::-1].copy(), SEEN) == MISSED
    both, two = np.concatenate([FACES, FACES[:, ::-1]]), np.ones(4, np.bool_)
    assert base.costs(pose, one, both, two) == base.costs(pose, one, FACES, SEEN) < MISSED
