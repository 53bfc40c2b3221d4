"""Contours of masks: where an ideal edge is, to a fraction of a pixel, with calm normals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.segment.contour import Contour, Tracing, extract_contour

Mask = NDArray[np.bool_]


def grid(size: int = 120) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x and y of pixel centres."""
    row, column = np.mgrid[:size, :size].astype(np.float64)
    return column, row


def disc(radius: float, x: float = 60.0, y: float = 60.0, size: int = 120) -> Mask:
    column, row = grid(size)
    return (column - x) ** 2 + (row - y) ** 2 < radius**2


def degrees_between(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.degrees(np.arccos(np.clip((a * b).sum(-1), -1, 1)))


@pytest.mark.parametrize("radius", [8.0, 20.0, 50.0])
@pytest.mark.parametrize("centre", [(60.0, 60.0), (59.63, 60.21)])
def test_disc(radius: float, centre: tuple[float, float]) -> None:
    contour = extract_contour(disc(radius, *centre))
    ray = contour.points - np.array(centre)
    distance = np.linalg.norm(ray, axis=1)
    # around a pixel's centre all four sides round the same way
    assert abs(distance.mean() - radius) < (0.25 if centre == (60, 60) else 0.06)
    assert np.abs(distance - radius).max() < 0.6
    error = degrees_between(contour.normals, ray / distance[:, None])
    assert np.sqrt((error**2).mean()) < 2.0
    assert error.max() < 6.0
    np.testing.assert_allclose(np.linalg.norm(contour.normals, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("degrees", [0.0, 1.5, 7.0, 26.6, 45.0, 71.0, 90.0, 137.0, 222.0, 301.0])
def test_straight_edge_keeps_its_place_and_its_direction(degrees: float) -> None:
    normal = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    column, row = grid()
    inside = (column - 60) * normal[0] + (row - 60) * normal[1] < 0.27
    contour = extract_contour(inside)
    middle = (np.abs(contour.points - 60) < 30).all(1)
    offset = (contour.points[middle] - 60) @ normal
    # a line through pixel centres, or the wait for the next step of the stair, is the worst case
    assert abs(offset.mean() - 0.27) < (0.3 if degrees % 45 == 0 else 0.06)
    error = degrees_between(contour.normals[middle], normal)
    # at a small slope the stair's steps are further apart than any smoothing reaches
    assert np.sqrt((error**2).mean()) < (3.0 if degrees == 1.5 else 1.5)
    assert error.max() < 6.5


def test_edge_between_pixels_is_half_way() -> None:
    box = np.zeros((60, 60), bool)
    box[20:40, 10:50] = True
    contour = extract_contour(box)
    top = contour.points[(contour.normals[:, 1] < -0.999) & (np.abs(contour.points[:, 0] - 30) < 8)]
    assert len(top) > 10
    np.testing.assert_allclose(top[:, 1], 19.5, atol=1e-9)


def test_hole_has_normals_into_the_hole() -> None:
    ring = disc(40) & ~disc(15)
    contour = extract_contour(ring)
    ray = contour.points - 60
    distance = np.linalg.norm(ray, axis=1)
    inner = distance < 27
    assert abs(distance[inner].mean() - 15) < 0.2
    assert abs(distance[~inner].mean() - 40) < 0.2
    along = (contour.normals * ray).sum(1) / distance
    assert (along[inner] < -0.99).all()
    assert (along[~inner] > 0.99).all()


def test_small_islands_and_holes_are_dropped() -> None:
    clean = extract_contour(disc(40))
    spotted = disc(40)
    spotted[2:4, 2:5] = True
    spotted[60:62, 60] = False
    spotted[50, 50] = False
    np.testing.assert_array_equal(extract_contour(spotted).points, clean.points)
    with_holes = extract_contour(disc(40) & ~disc(6), settings=Tracing(smallest=0.0))
    assert len(with_holes) > len(clean)
    assert len(extract_contour(disc(40) & ~disc(6), settings=Tracing(smallest=0.1))) == len(clean)


def test_image_border_is_no_contour() -> None:
    contour = extract_contour(disc(40, x=10.0))
    assert contour.points[:, 0].min() > 2
    ray = contour.points - [10.0, 60.0]
    distance = np.linalg.norm(ray, axis=1)
    assert np.abs(distance - 40).max() < 0.6  # nothing bends towards the border
    assert degrees_between(contour.normals, ray / distance[:, None]).max() < 6
    assert len(contour) > 60


@pytest.mark.parametrize(
    "mask",
    [np.zeros((9, 9), bool), np.ones((9, 9), bool), np.zeros((0, 5), bool), np.eye(9) > 0],
    ids=["empty", "full", "no picture", "a line"],
)
def test_nothing_to_trace(mask: Mask) -> None:
    contour = extract_contour(mask)
    assert np.isfinite(contour.points).all()
    if not mask.any() or mask.all():
        assert len(contour) == 0


@pytest.mark.parametrize("width", [1, 2, 3])
def test_thin_parts_are_finite_and_have_two_sides(width: int) -> None:
    mask = np.zeros((60, 60), bool)
    mask[10:50, 30 : 30 + width] = True
    contour = extract_contour(mask)
    middle = np.abs(contour.points[:, 1] - 30) < 5
    assert np.isfinite(contour.normals).all()
    sides = np.unique(np.round(contour.points[middle, 0], 6))
    if width == 1:  # without area, like any speck
        assert len(contour) == 0
        return
    np.testing.assert_allclose(sides, [29.5, 29.5 + width], atol=1e-6)


def test_confidence_is_looked_up_computed_or_one() -> None:
    mask, (column, _) = disc(30), grid()
    assert (extract_contour(mask).confidence == 1).all()
    pictured = extract_contour(mask, column / 120)
    np.testing.assert_allclose(pictured.confidence, pictured.points[:, 0] / 120, atol=0.01)
    computed = extract_contour(mask, lambda points, normals: (normals[:, 1] + 1) / 2)
    np.testing.assert_allclose(computed.confidence, (computed.normals[:, 1] + 1) / 2)


def test_number_masks_and_slices() -> None:
    number = extract_contour(disc(30).astype(np.uint8) * 255)
    np.testing.assert_array_equal(number.points, extract_contour(disc(30)).points)
    some = number[::3]
    assert isinstance(some, Contour)
    np.testing.assert_array_equal(some.normals, number.normals[::3])


@pytest.mark.parametrize(
    ("mask", "confidence", "words"),
    [
        (np.zeros((3, 4, 5), bool), None, "mask has shape"),
        (disc(30), np.ones((4, 4)), "confidence has shape"),
        (disc(30), np.full((120, 120), 2.0), "outside 0 to 1"),
        (disc(30), np.full((120, 120), np.nan), "outside 0 to 1"),
        (disc(30), lambda points, normals: np.ones(3), "shape"),
    ],
)
def test_bad_input(mask: Mask, confidence: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        extract_contour(mask, confidence)  # type: ignore[arg-type]
