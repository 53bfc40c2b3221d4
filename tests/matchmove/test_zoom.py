"""A lens that zooms, told from a camera that walks."""

import pytest
from staged_sightings import FOCAL, MIDDLE, RATE, filmed

from perfcap.matchmove import find_zoom


@pytest.mark.parametrize("guess", [0.9, 1.0, 1.25])
@pytest.mark.parametrize("zoom", [1.5, 0.75])
def test_a_lens_that_zooms_is_found(zoom: float, guess: float) -> None:
    seen = filmed(zoom=zoom, turn=4.0)
    found = find_zoom(seen.sightings, seen.frames, (guess * FOCAL, MIDDLE, MIDDLE), RATE)
    shown = max(zoom, 1 / zoom) ** 0.75  # of four half seconds three are compared
    assert found == pytest.approx(shown, rel=0.03)


@pytest.mark.parametrize(("walk", "ahead"), [(0.0, 0.0), (0.0, 1.2), (0.0, -1.2), (1.0, 0.5)])
def test_a_lens_that_stays_is_none(walk: float, ahead: float) -> None:
    seen = filmed(walk=walk, ahead=ahead)
    assert find_zoom(seen.sightings, seen.frames, (FOCAL, MIDDLE, MIDDLE), RATE) is None


def test_few_corners_tell_nothing() -> None:
    seen = filmed(zoom=1.5, points=8)
    assert find_zoom(seen.sightings, seen.frames, (FOCAL, MIDDLE, MIDDLE), RATE) is None
