"""Entry points follow the device of what they are given: the same numbers, no mixture."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace

import pytest
import torch
from crowds import RATE, make_crowd
from pretended_card import CARD
from synthetic import actor
from takes import Take, make_take
from torch import Tensor

import perfcap
from perfcap.pipeline.joint_motion import JointMotion
from perfcap.pipeline.keep_apart import ApartConfig, keep_apart
from perfcap.pipeline.pose_refiner import PoseRefiner
from perfcap.pipeline.retargeting import retarget
from perfcap.pipeline.robot_feet import above_floor

HERE, THERE = (torch.zeros(0, dtype=torch.float64, device=each) for each in ("cpu", CARD))
SEVERAL = make_take(10, views=3, lifted=False)
ALONE = make_take(10)
MIXED = [3, 8, 1, 6, 0, 9, 4, 2, 7, 5]


def compare(run: Callable[[Tensor], Tensor], atol: float = 1e-6) -> None:
    """Run with what is like a tensor of the CPU, and like one of the other device."""
    here, there = run(HERE), run(THERE)
    assert there.device == CARD
    torch.testing.assert_close(there.cpu(), here, rtol=0, atol=atol)


def test_the_device_refuses_what_lies_elsewhere() -> None:
    there = torch.ones(3).to(CARD)
    with pytest.raises(RuntimeError, match="same device"):
        there + torch.ones(3)
    with pytest.raises(TypeError, match="numpy"):
        there.numpy()
    torch.testing.assert_close((2 * there).sum().item(), 6.0)


@pytest.mark.long
@pytest.mark.parametrize("take", [SEVERAL, ALONE], ids=["three views", "one view"])
@pytest.mark.parametrize("single", [False, True], ids=["a clip", "images"])
def test_refined_poses_and_their_gradients(take: Take, single: bool) -> None:
    def run(like: Tensor) -> Tensor:
        seen = take.detections.to(like)
        parts = seen.joints2d, seen.confidence2d, seen.joints3d
        if single:  # in no order
            parts = tuple(None if each is None else each[MIXED, None] for each in parts)
        pixels = parts[0].detach().requires_grad_()
        layer = PoseRefiner(deepcopy(take.actor)).to(like.device)
        joints = layer(take.cameras.to(like), pixels, *parts[1:]).joints
        (slope,) = torch.autograd.grad(joints.square().sum(), pixels)
        return torch.cat((joints.detach().flatten(), slope.flatten()))

    compare(run, 1e-4)


@pytest.mark.long
@pytest.mark.parametrize("take", [SEVERAL, ALONE], ids=["three views", "one view"])
def test_captures(take: Take) -> None:
    def run(like: Tensor) -> Tensor:
        person = deepcopy(take.actor).to(like)
        given = person, take.cameras.to(like), take.detections.to(like)
        return perfcap.capture(*given, 30.0).joints()

    compare(run, 1e-4)


@pytest.mark.long
def test_people_are_told_apart() -> None:
    crowd = make_crowd(2, frames=6, views=3, size=200)

    def run(like: Tensor) -> Tensor:
        given = crowd.cameras.to(like), crowd.candidates.to(like)
        return perfcap.associate(*given, RATE).people[0].joints2d

    compare(run)


@pytest.mark.long
def test_people_are_kept_apart() -> None:
    still = actor().skeleton.rest_motion(1)
    beside = replace(still, translation=still.translation + still.angles.new_tensor([1.1, 0, 0]))

    def run(like: Tensor) -> Tensor:
        people = [actor().to(like) for _ in range(2)]
        apart = keep_apart(
            people,
            [still.to(like), beside.to(like)],
            ApartConfig(rounds=1, steps=(0.04,), max_steps=3),
        )
        moved = apart[0].angles - still.to(like).angles
        assert moved.abs().max() > 1e-2
        return moved

    compare(run, 1e-4)


def test_another_build() -> None:
    def run(like: Tensor) -> Tensor:
        person = actor().to(like)
        bones = 0.05 * torch.ones(len(person.skeleton.group_names)).to(like)
        larger = person.resized(bones)
        return larger.surface(larger.skeleton.rest_motion(1))

    compare(run)


@pytest.mark.long
def test_motions_of_others() -> None:
    def run(like: Tensor) -> Tensor:
        person = deepcopy(SEVERAL.actor).to(like)
        pose = person.skeleton(SEVERAL.truth.to(like))
        moved = retarget(person, JointMotion(pose.rotation, pose.position), person, 30.0).motion
        lowered = replace(moved, translation=moved.translation - like.new_tensor([0, 0.2, 0]))
        return above_floor(person, lowered, 30.0).translation

    compare(run, 1e-4)
