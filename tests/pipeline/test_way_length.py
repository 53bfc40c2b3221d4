"""The length of the way of a given moving camera: feet that stand contradict another one."""

from dataclasses import replace

import pytest
import torch
from takes import Take, standing_take

from perfcap.actor.motion import Motion
from perfcap.geometry.camera import Camera
from perfcap.pipeline import Stage, capture
from perfcap.pipeline.way_length import way_doubts

FRAMES = 60


def scaled(camera: Camera, factor: float) -> Camera:
    """A way that is longer, all else alike."""
    centre = camera.centre[0] + factor * (camera.centre - camera.centre[0])
    return replace(camera, translation=-(camera.rotation @ centre[..., None])[..., 0])


def seen_by(take: Take, camera: Camera) -> Motion:
    """The motion that looks as it did to the true camera."""
    moved = (camera.centre - take.cameras.centre)[:, 0]
    return replace(take.truth, translation=take.truth.translation + moved)


@pytest.mark.parametrize("factor", [0.1, 0.4, 2.5, 10.0])
def test_another_length_is_named_with_the_factor(factor: float) -> None:
    take = standing_take(FRAMES)
    given = scaled(take.cameras, factor)
    (line,) = way_doubts(take.actor, seen_by(take, given), given, take.rate)
    said = float(line.split("way were ")[1].split()[0])
    assert abs(said * factor - 1) < 0.1


@pytest.mark.parametrize("factor", [0.6, 1.0, 1.7])
def test_about_the_right_length_is_not(factor: float) -> None:
    take = standing_take(FRAMES)
    given = scaled(take.cameras, factor)
    assert not [*way_doubts(take.actor, seen_by(take, given), given, take.rate)]


def test_nor_is_a_camera_at_rest_or_one_of_several() -> None:
    take = standing_take(FRAMES)
    given = scaled(take.cameras, 10.0)
    motion = seen_by(take, given)
    both = given.map(lambda part: torch.cat((part, part), 1) if part.dim() > 2 else part)
    assert both.views == 2
    assert not [*way_doubts(take.actor, motion, both, take.rate)]
    still = given.frames(torch.zeros(FRAMES, dtype=torch.long))
    assert not [*way_doubts(take.actor, motion, still, take.rate)]


def test_who_rides_beside_the_camera_says_nothing() -> None:
    """Nothing stands on the ground: feet move as the camera does, or by a tenth of it beside."""
    take = standing_take(FRAMES)
    way = (take.cameras.centre - take.cameras.centre[0])[:, 0]
    for share in (1.0, 0.9):
        riding = replace(take.truth, translation=take.truth.translation + share * way)
        assert not [*way_doubts(take.actor, riding, take.cameras, take.rate)]


@pytest.mark.long
def test_a_capture_says_it() -> None:
    take = standing_take(FRAMES)
    for factor, named in ((1.0, 0), (10.0, 1)):
        given = scaled(take.cameras, factor)
        found = capture(take.actor, given, take.detections, take.rate, until=Stage.TRACK_MOTION)
        assert sum("the camera's way were" in line for line in found.warnings) == named
