"""Motions as points of a manifold."""

import math

import pytest
import torch
from synthetic import random_motion, rest_positions

from perfcap.actor.anatomy import human_rig
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.solve.energy import Step

F64 = torch.float64
SKELETON = Skeleton(human_rig(rest_positions()))


def random_step(motion: Motion, size: float = 1.0) -> Step:
    random = torch.Generator().manual_seed(8)
    here = motion.coordinates()
    frame = torch.randn(here.frame.shape, generator=random, dtype=here.frame.dtype)
    shared = torch.randn(here.shared.shape, generator=random, dtype=here.frame.dtype)
    turn = frame[..., 3:6]
    # shorter than half a turn, where the inverse is unique
    frame[..., 3:6] = 2.5 * turn / (1 + turn.norm(dim=-1, keepdim=True))
    return Step(size * frame, size * shared)


@pytest.mark.parametrize("shape", [False, True])
@pytest.mark.parametrize("batch", [(), (2,)])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_local_undoes_retract(shape: bool, batch: tuple[int, ...], dtype: torch.dtype) -> None:
    motion = random_motion(SKELETON, 30, batch, bones=shape).to(torch.zeros((), dtype=dtype))
    step = random_step(motion)
    moved = motion.retract(step)
    back = motion.local(moved)
    tolerance = 50 * torch.finfo(dtype).eps
    assert moved.angles.dtype == moved.rotation.dtype == back.frame.dtype == dtype
    assert back.frame.shape == step.frame.shape == (*batch, 30, 33)
    assert (back.frame - step.frame).abs().max() < tolerance
    assert (back.shared - step.shared).abs().max() < tolerance if shape else True
    assert back.shared.shape == (*batch, sum(motion.shared_sizes.values()))


def test_zero_step_is_the_identity() -> None:
    motion = random_motion(SKELETON, 20, bones=True)
    here = motion.coordinates()
    moved = motion.retract(Step(torch.zeros_like(here.frame), torch.zeros_like(here.shared)))
    there = moved.coordinates()
    assert torch.allclose(there.frame, here.frame, atol=1e-15)
    assert torch.equal(there.shared, here.shared)
    assert motion.local(motion).frame.abs().max() < 1e-15


def test_steps_turn_in_world_axes() -> None:
    motion = random_motion(SKELETON, 10)
    step = random_step(motion)
    expected = rotvec_to_matrix(step.frame[:, 3:6]) @ rotvec_to_matrix(motion.rotation)
    assert torch.allclose(rotvec_to_matrix(motion.retract(step).rotation), expected, atol=1e-13)


def test_small_steps_lead_through_full_turns() -> None:
    motion = SKELETON.rest_motion()
    step = Step(torch.zeros(1, 33, dtype=F64), torch.zeros(0, dtype=F64))
    step.frame[0, 4] = 2 * math.pi / 40
    for count in range(1, 121):
        motion = motion.retract(step)
        turn = rotvec_to_matrix(motion.rotation[0])
        angle = count * 2 * math.pi / 40
        ahead = torch.tensor([math.sin(angle), 0.0, math.cos(angle)], dtype=F64)
        assert torch.allclose(turn[:, 2], ahead, atol=1e-12)
        assert motion.rotation.norm() <= math.pi + 1e-12


def test_retract_differentiates() -> None:
    motion = random_motion(SKELETON, 2, bones=True)
    step = random_step(motion, 0.3)

    def moved(frame: torch.Tensor, shared: torch.Tensor) -> torch.Tensor:
        there = motion.retract(Step(frame, shared)).coordinates()
        return torch.cat((there.frame.flatten(), there.shared))

    inputs = (step.frame.requires_grad_(), step.shared.requires_grad_())
    assert torch.autograd.gradcheck(moved, inputs, check_forward_ad=True)


def test_frames_are_selected_together() -> None:
    motion = random_motion(SKELETON, 6, (2,), bones=True)
    part = motion[torch.tensor([4, 1])]
    assert part.frames == 2
    assert torch.equal(part.angles, motion.angles[:, [4, 1]])
    assert torch.equal(part.translation, motion.translation[:, [4, 1]])
    assert part.shared is motion.shared
    assert motion[1:3].rotation.shape == (2, 2, 3)


def test_sizes_of_the_tangent() -> None:
    motion = random_motion(SKELETON, 6, bones=True)
    assert (motion.frame_dim, motion.shared_sizes) == (33, {"bones": len(SKELETON.group_names)})
    assert random_motion(SKELETON, 6).shared_sizes == {}


def test_mismatched_parts_are_refused() -> None:
    with pytest.raises(ValueError, match="motion rotation has shape"):
        Motion(torch.zeros(3, 3), torch.zeros(2, 3), torch.zeros(3, 27))


def test_what_follows_from_a_motion_is_computed_once() -> None:
    motion, calls = random_motion(SKELETON, 2), []
    for _ in range(2):
        assert motion.once("count", lambda: calls.append(1) or len(calls)) == 1
    moved = motion[0:1]
    assert moved.once("count", lambda: calls.append(1) or len(calls)) == 2


@pytest.mark.parametrize("part", ["translation", "rotation", "angles"])
def test_what_is_changed_in_place_is_computed_again(part: str) -> None:
    motion = random_motion(SKELETON, 3)
    first = SKELETON.linearize(motion)[0].clone()
    getattr(motion, part).add_(0.1)
    again = SKELETON.linearize(motion)[0]
    assert not torch.allclose(again, first)
    assert torch.equal(again, SKELETON.linearize(motion[:])[0])
    kept = again.clone()
    again.add_(1)  # callers may do with it what they want
    assert torch.equal(SKELETON.linearize(motion)[0], kept)
