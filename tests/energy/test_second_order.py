"""Closed second derivatives agree with automatic ones."""

from dataclasses import replace

import pytest
import torch
from synthetic import actor, cameras, random_motion
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy.joint_position import JointPosition
from perfcap.energy.joint_target import JointTarget
from perfcap.energy.joint_trajectory import JointTrajectory
from perfcap.energy.prior import BoneLengthPrior, PosePrior
from perfcap.energy.reprojection import Reprojection
from perfcap.energy.trajectory import Trajectory
from perfcap.solve.energy import Energy, WindowEnergy
from perfcap.solve.second_order import second_order, twice_differentiated

F64 = torch.float64
ACTOR = actor()
FRAMES = 3


def normal(*shape: int, seed: int = 1) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=F64)


def energies(distorted: bool) -> dict[str, Energy]:
    camera = cameras(2)
    if distorted:
        bend = torch.tensor([0.1, -0.05, 0.003, -0.002, 0.01], dtype=F64)
        camera = replace(camera, distortion=bend.repeat(2, 1))
    seen = Detections.from_joints(
        200 + 50 * normal(2, FRAMES, 2, 16, 2),
        torch.ones(2, FRAMES, 2, 16, dtype=F64),
        normal(2, FRAMES, 2, 16, 3),
    )
    unit = torch.linspace(0.5, 2, 16, dtype=F64)
    rest = ACTOR.skeleton.rest_angles
    groups = len(ACTOR.skeleton.group_names)
    return {
        "reprojection": Reprojection(ACTOR.landmarks, camera, seen, unit=torch.tensor([2.0, 5.0])),
        "position": JointPosition(ACTOR.landmarks, camera, seen, unit=unit),
        "stabilization": JointTarget(ACTOR.landmarks, normal(2, FRAMES, 1, 16, 3), unit=unit),
        "target": JointTarget(
            ACTOR.landmarks, normal(2, FRAMES, 2, 16, 3), torch.ones(2, FRAMES, 2, 16), unit=unit
        ),
        "prior": PosePrior(rest, 0.5),
        "usual": PosePrior(rest, 0.5, 1.0, (rest - 0.1, rest + 0.2), 0.1),
        "bones": BoneLengthPrior(groups, FRAMES),
        "trajectory": Trajectory(FRAMES, 2, translation=2.0, rotation=3.0, angles=4.0),
    }


@pytest.mark.long
@pytest.mark.parametrize("shape", [False, True])
@pytest.mark.parametrize("distorted", [False, True])
def test_closed_form_agrees_with_automatic(shape: bool, distorted: bool) -> None:
    state = random_motion(ACTOR.skeleton, FRAMES, (2,), bones=shape)
    for name, energy in energies(distorted).items():
        if name == "bones" and not shape:
            continue
        rows = energy.features if isinstance(energy, WindowEnergy) else residuals(energy)
        pull = normal(*rows(state).shape)
        automatic = twice_differentiated(rows, state, pull)
        closed = second_order(energy, state, pull)
        if closed is None:
            assert not automatic.frame.any() and not automatic.shared.any(), name
            continue
        scale = automatic.frame.abs().max()
        torch.testing.assert_close(closed.frame, automatic.frame, rtol=1e-9, atol=1e-10 * scale)
        if shape and energy.sees:
            for part in ("border", "shared"):
                expected = getattr(automatic, part)
                torch.testing.assert_close(
                    getattr(closed, part), expected, rtol=1e-9, atol=1e-10 * scale
                )


def residuals(energy: Energy):
    def rows(state: Motion) -> Tensor:
        return energy.residual(state).value

    return rows


@pytest.mark.parametrize("shape", [False, True])
def test_joint_trajectory_bends_with_its_points(shape: bool) -> None:
    energy = JointTrajectory(ACTOR.landmarks, FRAMES, 2, unit=0.05)
    state = energy.started(random_motion(ACTOR.skeleton, FRAMES, (2,), bones=shape))
    state = replace(state, rotation=state.rotation.flip(-2))  # off the paths it was started on
    pull = normal(*energy.residual(state).value.shape)
    closed = second_order(energy, state, pull)
    automatic = twice_differentiated(residuals(energy), state, pull)
    assert closed is not None
    assert automatic.frame.any()
    scale = automatic.frame.abs().max()
    torch.testing.assert_close(closed.frame, automatic.frame, rtol=1e-9, atol=1e-10 * scale)
    for part in ("border", "shared") if shape else ():
        torch.testing.assert_close(
            getattr(closed, part), getattr(automatic, part), rtol=1e-9, atol=1e-10 * scale
        )
