"""The way of a camera in metres: found from a person who stands, refused where it does not fit."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from synthetic import actor
from takes import Take, make_take, standing_take

from perfcap.actor.sole_points import sole_skeleton
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.matchmove import CameraWay, Ground
from perfcap.pipeline.camera_motion import CameraMotion, in_metres

FRAMES = 60
WRONG = 0.7


def taken(noise: float = 1.0) -> Take:
    """A person who stands still, filmed by a camera in a hand, with errors of so many pixels."""
    take = standing_take(FRAMES)
    found = take.detections
    random = torch.Generator().manual_seed(0)
    moved = noise * torch.randn(found.joints2d.shape, generator=random, dtype=torch.float64)
    detections = replace(found, joints2d=found.joints2d + moved)
    return replace(take, detections=detections)


def way_of(cameras: Camera, scale: float, moves: bool = True) -> CameraWay:
    """As what is behind a person would show it: from the first frame, of another length."""
    turn = cameras.rotation[:, 0] @ cameras.rotation[0, 0].mT
    shift = cameras.translation[:, 0] - (turn @ cameras.translation[0, 0])
    way = scale * shift.numpy() if moves else np.zeros((len(shift), 3))
    return CameraWay(turn.numpy(), way, 1 / WRONG, 0.03, moves, 0.9)


def assumed(cameras: Camera) -> Camera:
    """One fixed camera at the origin, with a lens that is too wide."""
    first = cameras.frames(torch.tensor([0])).map(lambda part: part[0])
    lens = first.intrinsics.clone()
    lens[..., :2, :2] *= WRONG
    turn = torch.eye(3, dtype=torch.float64)[None]
    return Camera(lens, turn, torch.zeros(1, 3, dtype=torch.float64), None, first.size)


@pytest.mark.parametrize("scale", [0.6, 1.0, 1.6])
def test_feet_that_stand_tell_how_long_a_way_is(scale: float) -> None:
    take = taken()
    way = way_of(take.cameras, scale)
    found = in_metres(actor(), assumed(take.cameras), take.detections, take.rate, way)
    true = way_of(take.cameras, 1.0).translation
    ratio = float(found.translation.norm() / np.linalg.norm(true))
    assert abs(math.log(ratio)) < 0.15
    assert found.factor == way.factor and np.array_equal(found.rotation, way.rotation)


def test_the_ground_tells_it_of_a_camera_that_hardly_walks() -> None:
    """As high above the lower foot as above the ground, where feet show next to nothing."""
    take = taken()
    way = way_of(take.cameras, 0.5)
    near = replace(way, translation=0.02 * way.translation)
    first = take.cameras.frames(torch.tensor([0]))
    up = first.rotation[0, 0] @ torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    soles = sole_skeleton(take.actor)(take.truth).landmarks[:1, -8:]
    lowest = float((first.to_camera(soles)[0, 0] @ up).amin())
    ground = Ground(up.numpy(), 0.01 * lowest, 0.01)  # a unit of which 100 are a metre
    given = assumed(take.cameras)
    wrong = replace(way, translation=0.01 * way_of(take.cameras, 1.0).translation)
    found = in_metres(actor(), given, take.detections, take.rate, wrong, ground)
    true = way_of(take.cameras, 1.0).translation
    assert abs(math.log(float(found.translation.norm() / np.linalg.norm(true)))) < 0.1
    assert found.up is not None and torch.equal(found.up, up)
    blind = in_metres(actor(), given, take.detections, take.rate, near)
    assert float(blind.translation.norm()) < 0.2 * np.linalg.norm(true)


def test_the_camera_that_moves_is_the_true_one() -> None:
    take = taken()
    motion = in_metres(
        *(actor(), assumed(take.cameras), take.detections, take.rate),
        way_of(take.cameras, 1.0, moves=False),
    )
    exact = replace(motion, translation=torch.from_numpy(way_of(take.cameras, 1.0).translation))
    found = exact.of_camera(assumed(take.cameras))
    assert found.moving and found.views == 1 and found.size == take.cameras.size
    points = take.actor.joints(take.truth)
    first = take.cameras.frames(torch.tensor([0]))
    here = first.to_camera(points[:1])[0, 0].expand(FRAMES, -1, -1)  # axes of the first camera
    seen, true = found.project(here), take.cameras.project(points)
    assert float((seen - true).abs().max()) < 1e-6


def test_a_camera_that_only_turns_has_no_length() -> None:
    take = taken()
    way = way_of(take.cameras, 1.0, moves=False)
    found = in_metres(actor(), assumed(take.cameras), take.detections, take.rate, way)
    assert float(found.translation.abs().max()) == 0 == found.reach


def test_what_is_said_and_written() -> None:
    turn = torch.tensor([0.0, 0.3], dtype=torch.float64)
    rotation = torch.eye(3, dtype=torch.float64).repeat(2, 1, 1)
    rotation[:, 0, 0] = rotation[:, 2, 2] = turn.cos()
    rotation[:, 0, 2], rotation[:, 2, 0] = turn.sin(), -turn.sin()
    shift = torch.tensor([[0.0, 0, 0], [0.3, 0.4, 0]], dtype=torch.float64)
    motion = CameraMotion(rotation, shift, 2.0, 0.03, 0.8)
    assert motion.turn == pytest.approx(0.3) and motion.reach == pytest.approx(0.5)
    values = motion.report()
    assert values["turn_degrees"] == pytest.approx(math.degrees(0.3))
    assert values["reach_m"] == pytest.approx(0.5) and values["factor"] == 2.0
    camera = make_take(1).cameras
    line = motion.sentence(camera)
    assert "17 degrees and 0.5 m" in line and "--camera-motion none" in line
    assert "m from" not in replace(motion, translation=0 * shift).sentence(camera)


def test_what_is_refused() -> None:
    take = taken()
    way = way_of(take.cameras, 1.0)
    given = assumed(take.cameras)
    with pytest.raises(InputError, match="moving"):
        in_metres(actor(), take.cameras, take.detections, take.rate, way)
    with pytest.raises(InputError, match="a way of 59 frames for 60"):
        short = replace(way, rotation=way.rotation[1:], translation=way.translation[1:])
        in_metres(actor(), given, take.detections, take.rate, short)
