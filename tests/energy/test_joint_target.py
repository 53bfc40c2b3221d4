"""Places of joints: zero at the truth, derivatives, confidence."""

import pytest
import torch
from checks import check_energy
from synthetic import actor, random_motion

from perfcap.actor.motion import Motion
from perfcap.actor.points import PointDifferences
from perfcap.energy.joint_target import JointTarget
from perfcap.errors import InputError
from perfcap.solve import Energy, LevenbergMarquardt, Objective, solve
from perfcap.solve.kernels import GemanMcClure

F64 = torch.float64
ACTOR = actor()
UNIT = torch.linspace(0.5, 2, 16, dtype=F64)


def test_zero_at_the_truth() -> None:
    motion = random_motion(ACTOR.skeleton, 3)
    places = ACTOR.joints(motion).unsqueeze(-3)
    energy = JointTarget(ACTOR.landmarks, places, torch.ones(3, 1, 16, dtype=F64))
    assert energy(motion) == 0
    # one joint in one frame is off by 3 units and counts half
    places[1, 0, 4, 2] += 3
    energy = JointTarget(
        ACTOR.landmarks, places, torch.full((3, 1, 16), 0.5, dtype=F64), weight=2.0
    )
    assert energy(motion) == pytest.approx(2 * 0.5 * 9)


def test_everything_an_energy_promises() -> None:
    random = torch.Generator().manual_seed(0)
    motion = random_motion(ACTOR.skeleton, 2, (2,), bones=True)
    places = torch.randn(2, 2, 3, 16, 3, generator=random, dtype=F64).requires_grad_()
    certain = torch.rand(2, 2, 3, 16, generator=random, dtype=F64).requires_grad_()
    settings = {"weight": 0.7, "kernel": GemanMcClure(2.0), "unit": UNIT}
    energy = JointTarget(ACTOR.landmarks, places, certain, **settings)

    def pick(index: int) -> tuple[Energy, Motion]:
        alone = Motion(
            motion.translation[index],
            motion.rotation[index],
            motion.angles[index],
            {"bones": motion.shared["bones"][index]},
        )
        return JointTarget(ACTOR.landmarks, places[index], certain[index], **settings), alone

    check_energy(energy, motion, pick=pick, inputs=(places, certain), atol=1e-5)


def test_shapes_that_do_not_fit() -> None:
    with pytest.raises(InputError, match=r"give \(\*b, F, C, 16, 3\)"):
        JointTarget(ACTOR.landmarks, torch.zeros(3, 1, 17, 3), torch.zeros(3, 1, 17))
    with pytest.raises(InputError, match=r"give \(\*b, F, C, 16, 3\)"):
        JointTarget(ACTOR.landmarks, torch.zeros(3, 1, 16, 3), torch.zeros(3, 16))


def test_one_source_is_the_stabilization_of_the_paper() -> None:
    """Xu et al. 2018, Eq. 12: the mean squared displacement of the joints of a frame."""
    motion = random_motion(ACTOR.skeleton, 3, (2,))
    joints = ACTOR.joints(motion)
    away = torch.tensor([0.03, 0.0, -0.04], dtype=F64)
    place = (joints + away).unsqueeze(-3)
    energy = JointTarget(ACTOR.landmarks, place, weight=0.06 / 16, unit=0.01)
    assert torch.allclose(energy(motion), torch.full((2,), 0.06 * 25 * 3, dtype=F64))


def test_pulls_to_the_places() -> None:
    truth = random_motion(ACTOR.skeleton, 3, seed=1)
    places = ACTOR.joints(truth).unsqueeze(-3)
    start = Motion(truth.translation + 0.1, truth.rotation + 0.1, truth.angles + 0.1)
    energy = Objective(stay=JointTarget(ACTOR.landmarks, places))
    found = solve(energy, start, LevenbergMarquardt(max_steps=30)).state
    assert (ACTOR.joints(found) - places[:, 0]).norm(dim=-1).max() < 1e-5


def test_millimetres_are_refused() -> None:
    person = actor()
    places = 1000 * person.joints(random_motion(person.skeleton, 3)).unsqueeze(-3)
    with pytest.raises(InputError, match="apart in a frame, expected metres"):
        JointTarget(person.landmarks, places)


def test_vectors_may_be_beside_places_far_from_the_origin() -> None:
    person = actor()
    points = PointDifferences(person.landmarks, [0, 8], [1, None])
    motion = random_motion(person.skeleton, 3)
    far = Motion(motion.translation + 60, motion.rotation, motion.angles)
    energy = JointTarget(points, points(far).unsqueeze(-3))
    assert float(energy(far)) == 0


def test_places_of_confidence_zero_may_be_anything() -> None:
    person = actor()
    motion = random_motion(person.skeleton, 3)
    places = person.joints(motion).unsqueeze(-3).clone()
    sure = torch.ones_like(places[..., 0])
    sure[1, 0, 4] = 0
    places[1, 0, 4] = torch.nan
    energy = JointTarget(person.landmarks, places, sure)
    assert float(energy.cost(energy.residual(motion)).abs().max()) == 0
    assert places[1, 0, 4].isnan().all()
