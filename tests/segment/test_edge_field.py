"""Edges: their strength, their direction, and that polarity and colours do not matter."""

import numpy as np
import pytest
from numpy.typing import NDArray

from perfcap.segment.edge_field import EdgeSettings, find_edges


def step(degrees: float, dark: int = 60, bright: int = 200) -> NDArray[np.uint8]:
    """A straight edge through the middle whose normal is at an angle to x."""
    y, x = np.mgrid[:61, :61] - 30.0
    turn = np.radians(degrees)
    share = np.clip(np.cos(turn) * x + np.sin(turn) * y + 0.5, 0, 1)[..., None]
    return np.asarray(dark + share * (bright - dark) * np.ones(3), np.uint8)


@pytest.mark.parametrize("degrees", [0, 30, 90, 135])
def test_direction_of_an_edge(degrees: float) -> None:
    field = find_edges(step(degrees))
    cosine, sine = field.edges[:, 30, 30]
    off = np.degrees(np.arctan2(sine, cosine)) - 2 * degrees
    assert abs((off + 180) % 360 - 180) < 3
    assert np.hypot(cosine, sine) == pytest.approx(EdgeSettings().clamp, abs=1e-5)
    assert field.flat[30, 30] == 0


def test_polarity_does_not_matter() -> None:
    one, other = find_edges(step(20)), find_edges(255 - step(20))
    np.testing.assert_allclose(one.edges, other.edges, atol=2e-3)


def test_channels_that_change_opposite_ways_do_not_cancel() -> None:
    picture = step(0)
    mixed = picture.copy()
    mixed[..., 1] = 255 - picture[..., 1]
    one, other = (find_edges(each).edges[:, 30, 30] for each in (picture, mixed))
    np.testing.assert_allclose(one, other, atol=1e-3)


def test_flat_places_cost_and_textures_do_not() -> None:
    settings = EdgeSettings(low=0.1)
    plain = find_edges(np.full((20, 30, 3), 90, np.uint8), settings, (4, 7))
    assert plain.corner == (4, 7) and plain.edges.shape == (2, 20, 30)
    np.testing.assert_allclose(plain.flat, 0.1, atol=1e-6)
    np.testing.assert_allclose(plain.edges, 0, atol=1e-6)
    noise = np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.uint8)
    assert find_edges(noise, settings).flat.mean() < 0.07


def test_a_single_pixel() -> None:
    field = find_edges(np.full((1, 1, 3), 5, np.uint8))
    assert np.isfinite(field.edges).all() and field.flat.shape == (1, 1)
