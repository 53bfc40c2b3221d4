"""Paths of joints as cosines with free coefficients: derivatives, what the kernel is for."""

from dataclasses import replace

import pytest
import torch
from checks import check_energy
from synthetic import actor, random_motion

from perfcap.actor.motion import Motion
from perfcap.energy import JointTarget, JointTrajectory
from perfcap.errors import InputError
from perfcap.solve import LevenbergMarquardt, Objective, solve
from perfcap.solve.kernels import GemanMcClure
from perfcap.temporal.subspace import dct_basis

F64 = torch.float64
ACTOR = actor()
FRAMES = 6


def element(motion: Motion, index: int) -> Motion:
    shape = {name: block[index] for name, block in motion.shared.items()}
    return Motion(motion.translation[index], motion.rotation[index], motion.angles[index], shape)


def energy(rank: int = 3, scale: float | None = 2.0) -> JointTrajectory:
    kernel = None if scale is None else GemanMcClure(scale)
    return JointTrajectory(ACTOR.landmarks, FRAMES, rank, 0.7, kernel, unit=0.05)


@pytest.mark.parametrize("bones", [False, True])
def test_derivatives_are_those_of_differences(bones: bool) -> None:
    term = energy()
    motion = random_motion(ACTOR.skeleton, FRAMES, bones=bones, batch=(2,))
    state = term.started(motion)
    random = torch.Generator().manual_seed(3)
    moved = {
        name: block + 0.02 * torch.randn(block.shape, generator=random, dtype=F64)
        for name, block in state.shared.items()
    }
    state = replace(state, shared=moved)

    def pick(index: int) -> tuple[JointTrajectory, Motion]:
        return term, element(state, index)

    check_energy(term, state, pick=pick)


def test_the_best_coefficients_leave_what_is_outside_the_subspace() -> None:
    term = energy(scale=None)
    motion = random_motion(ACTOR.skeleton, FRAMES)
    points = ACTOR.joints(motion).flatten(-2)
    basis = dct_basis(FRAMES, 3, dtype=F64)
    outside = points - basis.mT @ (basis @ points)
    expected = 0.7 * (outside / 0.05).square().sum()
    assert torch.allclose(term(term.started(motion)), expected, rtol=1e-12)


def test_whole_rank_costs_nothing() -> None:
    term = energy(rank=FRAMES)
    assert float(term(term.started(random_motion(ACTOR.skeleton, FRAMES)))) < 1e-18


def test_a_robust_path_ignores_a_frame_that_jumps() -> None:
    """The path through standing joints of which one frame is elsewhere: solved, it stands."""
    still = ACTOR.skeleton.rest_motion(FRAMES)
    jump = still.translation.clone()
    jump[2, 0] += 1.0
    motion = replace(still, translation=jump)
    found = {}
    for scale in (None, 0.5):
        term = energy(rank=1, scale=scale)
        start = term.started(motion)
        hold = JointTarget(ACTOR.landmarks, ACTOR.joints(motion).unsqueeze(-3), unit=0.01)
        free = solve(Objective(paths=term, hold=hold), start, LevenbergMarquardt(60)).state
        middle = term._paths(free)[0]
        found[scale] = float((middle - ACTOR.joints(still)[0]).norm(dim=-1).max())
    assert found[None] > 0.1 and found[0.5] < 0.02


def test_ranks_and_units_are_checked() -> None:
    with pytest.raises(InputError, match="rank is 9"):
        energy(rank=9)
    with pytest.raises(InputError, match="unit is 0"):
        JointTrajectory(ACTOR.landmarks, FRAMES, 2, unit=0)
    with pytest.raises(ValueError, match="see started"):
        energy()(ACTOR.skeleton.rest_motion(FRAMES))
