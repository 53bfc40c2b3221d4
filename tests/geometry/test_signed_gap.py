"""Distances from skins, which are negative inside."""

from __future__ import annotations

import numpy as np
import pytest

from perfcap.geometry.signed_gap import signed_gap

GRID = np.stack(np.meshgrid(np.linspace(0, 1, 101), np.linspace(0, 1, 101)), -1).reshape(-1, 2)
SHEET = (
    np.pad(GRID, ((0, 0), (0, 1))),
    np.tile([0.0, 0.0, 1.0], (len(GRID), 1)),
)  # z = 0, outside up


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((0.5, 0.5, 0.02), 0.02),
        ((0.5, 0.5, -0.02), -0.02),
        ((0.5, 0.5, -0.2), 0.2),  # too deep to be a contact
        ((1.05, 0.5, -0.01), np.hypot(0.05, 0.01)),  # beside the edge is not below the skin
    ],
)
def test_only_what_lies_under_a_skin_is_in_it(point: tuple[float, ...], expected: float) -> None:
    gap, nearest = signed_gap(np.array([point]), SHEET)
    assert gap[0] == pytest.approx(expected)
    assert np.linalg.norm(SHEET[0][nearest[0]] - point) == pytest.approx(abs(expected))
