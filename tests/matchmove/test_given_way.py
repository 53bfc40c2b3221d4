"""Corners of a floor and a wall against the way of a camera, right, wrong and another."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from staged_sightings import FOCAL, MIDDLE, RATE, SIDE, Array, filmed

from perfcap.matchmove.given_way import Compared, GivenWaySettings, SeenWay, compare_way, off_way


def seen(**about: float) -> SeenWay:
    """The true way of what ``filmed`` shows."""
    take = filmed(**about)  # type: ignore[arg-type]
    plane = (take.sightings.pixels - MIDDLE) / FOCAL
    focal = np.full(take.frames, FOCAL / SIDE)
    return SeenWay(take.sightings, plane, take.rotation, take.translation, focal, RATE)


def turned(way: SeenWay, degrees: Array) -> SeenWay:
    """A camera that is turned by so many degrees, (F, 3), about its own place."""
    matrix = Rotation.from_rotvec(degrees, degrees=True).as_matrix()
    shift = np.einsum("fij,fj->fi", matrix, way.translation)
    return replace(way, rotation=matrix @ way.rotation, translation=shift)


def share(compared: list[Compared]) -> float:
    return float(np.mean([each.wrong for each in compared]))


WAYS = [{}, {"walk": 1.0}, {"ahead": 1.0}, {"walk": 0.02, "turn": 1.0}, {"walk": 1.0, "wild": 0.2}]


@pytest.mark.parametrize("about", WAYS)
def test_the_true_way_fits_whether_it_turns_or_walks(about: dict[str, float]) -> None:
    compared = compare_way(seen(**about))
    assert len(compared) >= 4 and share(compared) == 0
    assert max(each.off for each in compared) < 0.002


@pytest.mark.parametrize("about", WAYS)
def test_one_that_drifts_does_not(about: dict[str, float]) -> None:
    way = seen(**about)
    drift = np.linspace(0, 4, len(way.rotation))[:, None] * np.array([1.0, 0.0, 0.0])
    assert share(compare_way(turned(way, drift))) == 1
    assert share(compare_way(turned(way, drift), GivenWaySettings(off=0.1))) == 0


def test_a_lens_that_zooms_and_a_way_back() -> None:
    assert share(compare_way(seen(walk=0.3, zoom=1.4))) > 0.8
    way = seen(walk=1.0, turn=20.0)
    back = replace(way, rotation=way.rotation[::-1], translation=way.translation[::-1])
    assert share(compare_way(back)) > 0.8


def test_poses_of_later_frames() -> None:
    way = seen(walk=1.0, turn=20.0)
    pair = compare_way(way)[0].pair
    late = replace(
        way, rotation=np.roll(way.rotation, 5, 0), translation=np.roll(way.translation, 5, 0)
    )
    assert off_way(late, pair, 5) == off_way(way, pair) < 0.1 * off_way(late, pair)


def test_the_length_of_a_way_shows_nowhere() -> None:
    way = seen(walk=0.5)
    assert share(compare_way(replace(way, translation=2 * way.translation))) == 0


def test_lines_that_are_read_late_are_no_error() -> None:
    """A camera that swings faster and faster shifts lower lines by more and more."""
    way = seen(walk=0.5)
    speed = 0.1 * np.linspace(0, 1, len(way.rotation))[way.sightings.frame]
    rolled = way.plane + np.stack((speed * way.plane[:, 1], 0 * speed), -1)
    assert max(each.off for each in compare_way(replace(way, plane=rolled))) < 0.002


def test_what_no_camera_explains_says_nothing() -> None:
    """A crowd, of which each goes where it likes; too few corners; and a strip of them."""
    way = seen(walk=1.0, wild=1.0)
    compared = compare_way(way)
    assert max(each.off for each in compared) > 0.005 and share(compared) == 0
    few = replace(way, sightings=way.sightings.part(way.sightings.point < 20))
    few = replace(few, plane=way.plane[way.sightings.point < 20])
    assert compare_way(few) == []
    strip = np.abs(way.plane[:, 0]) < 0.05
    narrow = replace(way, sightings=way.sightings.part(strip), plane=way.plane[strip])
    assert compare_way(narrow, GivenWaySettings(least=5)) == []
    none = replace(way, sightings=way.sightings.part(strip & ~strip), plane=way.plane[:0])
    assert compare_way(none) == []
