"""Stabilization: what Eq. 12 says, derivatives, and that it holds joints where they are."""

from dataclasses import replace

import pytest
import torch
from checks import check_energy
from synthetic import actor, random_motion

from perfcap.actor.motion import Motion
from perfcap.energy.stabilization import Stabilization
from perfcap.errors import InputError
from perfcap.solve import Energy, LevenbergMarquardt, Objective, solve
from perfcap.solve.energy import forward_mode
from perfcap.solve.kernels import Huber

ACTOR = actor()
FRAMES = 3


def test_is_the_mean_squared_displacement() -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, (2,))
    joints = ACTOR.joints(motion)
    away = torch.tensor([0.03, 0.0, -0.04], dtype=torch.float64)
    energy = Stabilization(ACTOR, joints + away, weight=0.06, unit=0.01)
    assert torch.allclose(energy(motion), torch.full((2,), 0.06 * 25 * FRAMES).double())
    assert Stabilization(ACTOR, joints)(motion).abs().max() < 1e-24


def test_everything_an_energy_promises() -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, (2,), shape=True)
    reference = ACTOR.joints(random_motion(ACTOR.skeleton, FRAMES, (2,), seed=1)).clone()
    unit = torch.linspace(0.5, 2, 16, dtype=torch.float64)

    def make(reference: torch.Tensor) -> Stabilization:
        return Stabilization(ACTOR, reference, 2.0, Huber(0.3), unit)

    def pick(index: int) -> tuple[Energy, Motion]:
        parts = (motion.translation[index], motion.rotation[index], motion.angles[index])
        assert motion.shape is not None
        return make(reference[index].detach()), Motion(*parts, motion.shape[index])

    leaf = reference.requires_grad_()
    check_energy(make(leaf), motion, pick=pick, inputs=(leaf,))
    known = replace(motion, shape=None)
    closed, exact = make(leaf).linearize(known), forward_mode(make(leaf), known)
    assert torch.allclose(closed.frame, exact.frame, atol=1e-12)


def test_pulls_back_to_the_reference() -> None:
    truth = random_motion(ACTOR.skeleton, FRAMES, seed=1)
    reference = ACTOR.joints(truth)
    start = random_motion(ACTOR.skeleton, FRAMES, seed=1)
    start = Motion(start.translation + 0.1, start.rotation + 0.1, start.angles + 0.1)
    energy = Objective(stay=Stabilization(ACTOR, reference))
    found = solve(energy, start, LevenbergMarquardt(max_steps=30)).state
    assert (ACTOR.joints(found) - reference).norm(dim=-1).max() < 1e-5


def test_bad_reference_is_refused() -> None:
    with pytest.raises(InputError, match=r"reference has shape \(3, 15, 3\)"):
        Stabilization(ACTOR, torch.zeros(3, 15, 3))
