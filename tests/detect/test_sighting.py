"""Sightings of people: what speaks for one person, and what against it."""

import numpy as np
import pytest
import torch
from made_up_eyes import PLACES
from numpy.typing import NDArray

from perfcap.detect.crop import Crop
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.detect.look import Look
from perfcap.detect.sighting import Sighting, Trace

SIZE = (200, 300)  # of the frames
RED, BLUE = (200, 30, 30), (30, 30, 200)


def painted(color: tuple[int, int, int]) -> NDArray[np.uint8]:
    return np.full((*SIZE, 3), color, np.uint8)


def sighting(
    x: float, height: float = 100, frame: NDArray[np.uint8] | None = None, unseen: int = 0
) -> Sighting:
    """Of somebody who stands at x, the last joints of whom are not seen."""
    points = height * PLACES + torch.tensor([x, 40.0])
    trust = (torch.arange(16) < 16 - unseen).float()
    crop = Crop.around((0, 0, 100, 100), (96, 96))
    return Sighting.of(Look(crop, points, trust, None, None), LANDMARKS16, frame)


def test_colors_are_those_of_the_clothes() -> None:
    frame = painted(BLUE)
    frame[: 40 + 52] = RED  # above the hips
    torso, thighs = sighting(150, frame=frame).colors
    red, blue = (sighting(150, frame=painted(color)).colors[0] for color in (RED, BLUE))
    assert torch.equal(torso, red) and torch.equal(thighs, blue)
    assert sighting(150, frame=painted(RED)).unlike(sighting(80, frame=painted(RED))) == 0
    assert sighting(150, frame=painted(RED)).unlike(sighting(80, frame=painted(BLUE))) > 0.9


def test_outside_the_frame_nothing_has_a_color() -> None:
    away = sighting(900, frame=painted(RED))
    assert away.colors.isnan().all()
    assert away.unlike(sighting(150, frame=painted(BLUE))) == 0
    assert sighting(150).colors.isnan().all(), "without a frame"


def test_a_joint_more_or_less_moves_nobody() -> None:
    way, pose = sighting(100).moved(sighting(107, unseen=6))
    assert way.tolist() == pytest.approx([7, 0]) and pose == pytest.approx(0, abs=1e-6)
    way, pose = sighting(100).moved(sighting(107, unseen=14))
    assert pose == 0.25, "too few to compare"


def test_who_walks_is_expected_where_they_would_be() -> None:
    trace = Trace.from_sighting(sighting(100))
    for x in (110, 120, 130):
        trace = trace.after(sighting(x))
    trace = trace.after(None).after(None)
    assert trace.cost(sighting(160)) == pytest.approx(0, abs=1e-6)
    assert trace.cost(sighting(130)) == pytest.approx(0.3, abs=0.02)
    assert (trace.age, trace.count) == (2, 4)


@pytest.mark.parametrize(
    ("other", "least"),
    [
        (sighting(140, frame=painted(RED)), 0.3),  # elsewhere
        (sighting(100, frame=painted(BLUE)), 0.3),  # in other clothes
        (sighting(100, 50, painted(RED)), 0.2),  # half as tall
    ],
)
def test_what_speaks_for_somebody_else(other: Sighting, least: float) -> None:
    trace = Trace.from_sighting(sighting(100, frame=painted(RED)))
    assert trace.cost(sighting(100, frame=painted(RED))) == 0
    assert trace.cost(other) > least


def test_who_was_away_for_long_may_be_anywhere_in_the_same_clothes() -> None:
    trace = Trace.from_sighting(sighting(20, frame=painted(RED)))
    there = sighting(280, frame=painted(RED))
    assert trace.cost(there) > 2 and trace.cost(there, anywhere=True) <= 1.0 + 1e-6
    assert trace.cost(sighting(280, frame=painted(BLUE)), anywhere=True) > 1.3


def test_colors_of_a_trace_are_those_of_all_its_sightings() -> None:
    trace = Trace.from_sighting(sighting(100, frame=painted(RED)))
    own = trace.last.colors
    assert torch.equal(trace.after(sighting(100)).last.colors, own), "unknown changes nothing"
    mixed = trace.after(sighting(100, frame=painted(BLUE))).last.colors
    new = sighting(100, frame=painted(BLUE)).colors
    torch.testing.assert_close(mixed, torch.lerp(own, new, 0.2))
    first = Trace.from_sighting(sighting(100)).after(sighting(100, frame=painted(RED)))
    assert torch.equal(first.last.colors, own)


def test_who_is_seen_in_part_is_no_smaller() -> None:
    """A head seen alone made everybody else ten bodies away."""
    trace = Trace.from_sighting(sighting(100))
    part = sighting(100, unseen=13)
    assert part.size < 0.4 * trace.size
    assert trace.after(part).size == pytest.approx(0.97 * trace.size)
    assert trace.after(part).cost(sighting(130)) == pytest.approx(0.32, abs=0.02)
    assert trace.after(sighting(100, 150)).size == sighting(100, 150).size
