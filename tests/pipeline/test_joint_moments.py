"""Rotations and positions of other moments, and a scale of other legs."""

import warnings
from dataclasses import replace

import pytest
import torch
from synthetic import actor
from takes import sway
from torch import Tensor

from perfcap.actor.anatomy import JOINTS
from perfcap.pipeline.config import RetargetConfig
from perfcap.pipeline.joint_moments import moment_doubts
from perfcap.pipeline.joint_motion import JointMotion, leg_length, require_same_limbs
from perfcap.pipeline.retargeting import retarget

F64 = torch.float64
PERSON = actor()
COUNT, MORE = 60, 15
FREE = RetargetConfig()
FREE = replace(FREE, contact=replace(FREE.contact, enabled=False))


def walk(pace: float = 0.8, frames: int = COUNT + 2 * MORE) -> JointMotion:
    """Steps at so many a second, and trunk and arms that sway otherwise."""
    motion = sway(PERSON, frames)
    names = PERSON.skeleton.angle_names
    time = torch.arange(frames, dtype=F64) / 30
    angles = motion.angles.clone()
    for side, phase in (("l", 0.0), ("r", torch.pi)):
        lift = torch.sin(2 * torch.pi * pace * time + 0.2 * time**2 + phase).clamp(min=0)
        angles[:, names.index(f"{side}_hip_flexion")] = 0.7 * lift
        angles[:, names.index(f"{side}_knee_flexion")] = 1.4 * lift
        angles[:, names.index(f"{side}_elbow_flexion")] = 0.2 + 0.8 * lift
    pose = PERSON.skeleton(replace(motion, angles=angles))
    return JointMotion(pose.rotation, pose.position)


WALK = walk()
TURNS, PLACES = WALK.rotation[MORE:-MORE], WALK.position[MORE:-MORE]


def said(rotation: Tensor, position: Tensor, rate: float = 30.0) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        require_same_limbs(PERSON, JointMotion(rotation, position), rate)
    return [str(each.message) for each in caught]


def noise(metres: float) -> Tensor:
    return metres * torch.randn(PLACES.shape, generator=torch.Generator().manual_seed(0), dtype=F64)


@pytest.mark.parametrize("late", [-15, -10, -5, -2, 2, 5, 10, 15])
@pytest.mark.parametrize("metres", [0.0, 0.01])
def test_positions_of_later_and_earlier_frames(late: int, metres: float) -> None:
    """They gave a motion 10 cm and more from the right one, with nothing said."""
    shown = WALK.position[MORE + late : MORE + late + COUNT]
    (line,) = said(TURNS, shown + noise(metres))
    words = f"{abs(late)} frames {'later' if late > 0 else 'earlier'} than rotations"
    assert f"positions show moments about {words}" in line
    assert "degrees or more off its joints' line" in line


def test_the_degrees_are_those_of_the_limbs() -> None:
    """All limbs are off by as much, in all frames."""
    shown = torch.tensor([0.0, -1.0, 0.0], dtype=F64).expand(20, 8, 3)

    def off(degrees: float) -> list[str]:
        angle = torch.tensor(degrees * torch.pi / 180, dtype=F64)
        carried = torch.stack((angle.sin(), -angle.cos(), 0 * angle)).expand(20, 8, 3)
        return list(moment_doubts(carried, shown, 30.0))

    (line,) = off(20.0)
    assert "rotations take one limb in twenty 20 degrees or more off its joints' line" in line
    assert "expected both of the same frames of one clip, and of this source" in line
    (line,) = off(40.0)
    assert "rotations take the source's limbs 40 degrees from where its joints are" in line
    assert off(10.0) == []


def test_positions_backwards_and_of_another_clip() -> None:
    (line,) = said(TURNS, PLACES.flip(0))
    assert "positions run backwards as against rotations" in line
    for position in (walk(1.3).position, walk(0.75).position):
        (line,) = said(TURNS, position[:COUNT])
        assert "of the same frames of one clip" in line and "show moments" not in line


@pytest.mark.parametrize("step", [1, 2, 6])
@pytest.mark.parametrize("metres", [0.0, 0.01, 0.02])
def test_right_ones_are_silent(step: int, metres: float) -> None:
    shown = (PLACES + noise(metres))[::step]
    assert said(TURNS[::step], shown, 30.0 / step) == []
    assert said(TURNS[:1], PLACES[:1]) == []


def test_positions_of_limbs_that_stretch_and_of_other_bones_are_silent() -> None:
    grown = PERSON.resized(torch.full((len(PERSON.skeleton.group_names),), 0.2, dtype=F64))
    pose = grown.skeleton(sway(grown, COUNT))
    with_own = PERSON.skeleton(sway(PERSON, COUNT)).rotation
    assert said(with_own, pose.position) == []
    stretched = PLACES.clone()
    for side in "lr":
        elbow, wrist = (JOINTS.index(f"{side}_{name}") for name in ("elbow", "wrist"))
        more = 0.3 * torch.linspace(-1, 1, COUNT, dtype=F64)[:, None]
        stretched[:, wrist] += more * (PLACES[:, wrist] - PLACES[:, elbow])
    assert said(TURNS, stretched) == []


@pytest.mark.parametrize(("times", "named"), [(0.3, True), (0.6, False), (1.9, False), (2.5, True)])
def test_a_scale_of_other_legs(times: float, named: bool) -> None:
    """A tenth of the right one gave feet that slide by centimetres a frame, with nothing said."""
    small = PERSON.resized(torch.full((len(PERSON.skeleton.group_names),), -0.3, dtype=F64))
    ratio = leg_length(small) / leg_length(PERSON)
    joints = JointMotion(TURNS[:4], PLACES[:4])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        retarget(PERSON, joints, small, 30.0, FREE, times * ratio, examined=True)
    lines = [str(each.message) for each in caught]
    words = f"scale is {times * ratio:.3g}, and the target's legs are {ratio:.3g} times as long"
    assert any(words in line for line in lines) == named, lines
    assert named or not lines
