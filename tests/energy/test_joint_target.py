"""Places of joints: zero at the truth, derivatives, confidence."""

import pytest
import torch
from checks import check_energy
from synthetic import actor, random_motion

from perfcap.actor.motion import Motion
from perfcap.energy.joint_target import JointTarget
from perfcap.errors import InputError
from perfcap.solve import Energy
from perfcap.solve.kernels import GemanMcClure

F64 = torch.float64
ACTOR = actor()
UNIT = torch.linspace(0.5, 2, 16, dtype=F64)


def test_zero_at_the_truth() -> None:
    motion = random_motion(ACTOR.skeleton, 3)
    places = ACTOR.joints(motion).unsqueeze(-3)
    energy = JointTarget(ACTOR, places, torch.ones(3, 1, 16, dtype=F64))
    assert energy(motion) == 0
    # one joint in one frame is off by 3 units and counts half
    places[1, 0, 4, 2] += 3
    energy = JointTarget(ACTOR, places, torch.full((3, 1, 16), 0.5, dtype=F64), weight=2.0)
    assert energy(motion) == pytest.approx(2 * 0.5 * 9)


def test_everything_an_energy_promises() -> None:
    random = torch.Generator().manual_seed(0)
    motion = random_motion(ACTOR.skeleton, 2, (2,), shape=True)
    places = torch.randn(2, 2, 3, 16, 3, generator=random, dtype=F64).requires_grad_()
    certain = torch.rand(2, 2, 3, 16, generator=random, dtype=F64).requires_grad_()
    settings = {"weight": 0.7, "kernel": GemanMcClure(2.0), "unit": UNIT}
    energy = JointTarget(ACTOR, places, certain, **settings)

    def pick(index: int) -> tuple[Energy, Motion]:
        assert motion.shape is not None
        alone = Motion(
            motion.translation[index],
            motion.rotation[index],
            motion.angles[index],
            motion.shape[index],
        )
        return JointTarget(ACTOR, places[index], certain[index], **settings), alone

    check_energy(energy, motion, pick=pick, inputs=(places, certain), atol=1e-5)


def test_shapes_that_do_not_fit() -> None:
    with pytest.raises(InputError, match=r"give \(\*b, F, C, 16, 3\)"):
        JointTarget(ACTOR, torch.zeros(3, 1, 17, 3), torch.zeros(3, 1, 17))
    with pytest.raises(InputError, match=r"give \(\*b, F, C, 16, 3\)"):
        JointTarget(ACTOR, torch.zeros(3, 1, 16, 3), torch.zeros(3, 16))
