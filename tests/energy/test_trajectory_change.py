"""Changes of a motion: the motion is free, fast changes of it are not."""

import math
from dataclasses import replace

import torch
from checks import check_energy
from synthetic import random_motion, rest_positions

from perfcap.actor.anatomy import human_rig
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.energy.trajectory import TrajectoryChange
from perfcap.geometry.rotation import compose_rotvec
from perfcap.solve.energy import Energy
from perfcap.temporal.subspace import dct_basis

F64 = torch.float64
SKELETON = Skeleton(human_rig(rest_positions()))
KEEP = torch.tensor([1.0, 1.0, 0.7, 0.2], dtype=F64)


def test_any_motion_is_free() -> None:
    motion = random_motion(SKELETON, 20)
    assert TrajectoryChange(motion, KEEP)(motion) == 0


def test_slow_changes_are_free_and_fast_ones_cost_what_they_are() -> None:
    motion, basis = random_motion(SKELETON, 20), dct_basis(20, dtype=F64)
    energy = TrajectoryChange(motion, KEEP, translation=2.0)
    slow = torch.outer(basis[1], torch.tensor([0.1, 0.2, 0.3], dtype=F64))
    fast = torch.outer(basis[9], torch.tensor([0.1, 0.2, 0.3], dtype=F64))
    assert energy(replace(motion, translation=motion.translation + slow)) < 1e-20
    cost = energy(replace(motion, translation=motion.translation + fast))
    assert torch.allclose(cost, 4 * fast.square().sum())


def test_half_a_turn_is_no_edge() -> None:
    """A person who has turned around: vectors of rotations jump by a full turn there."""
    axis = torch.tensor([0.0, 1.0, 0.0], dtype=F64)
    rest = SKELETON.rest_motion(20)
    before = replace(rest, rotation=(math.pi - 1e-3) * axis.expand(20, 3))
    after = compose_rotvec(2e-3 * axis.expand(20, 3), before.rotation)
    assert (after - before.rotation).norm() > 6
    energy = TrajectoryChange(before, KEEP[:1], rotation=1.0)
    moved = replace(before, rotation=after)
    assert energy(moved) < 1e-9
    _, jacobian = energy.linearize_features(moved)
    assert energy.features(moved).abs().max() < 3e-3
    assert torch.allclose(jacobian, energy.linearize_features(before)[1], atol=3e-3)


def test_everything_an_energy_promises() -> None:
    given, motion = (random_motion(SKELETON, 6, (2,), seed=seed) for seed in (1, 2))
    scales = {"translation": 0.7, "rotation": 1.3, "angles": 0.4}

    def pick(index: int) -> tuple[Energy, Motion]:
        alone = given.map(lambda each: each[index])
        return TrajectoryChange(alone, KEEP, 0.5, **scales), motion.map(lambda each: each[index])

    check_energy(TrajectoryChange(given, KEEP, 0.5, **scales), motion, pick=pick, inputs=())
