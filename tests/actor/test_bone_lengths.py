"""Actors of another size."""

import numpy as np
import pytest
import torch
from synthetic import actor, random_motion
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.errors import InputError

F64 = torch.float64


@pytest.fixture(scope="module")
def person() -> Actor:
    return actor()


def random_shape(skeleton: Skeleton) -> Tensor:
    random = torch.Generator().manual_seed(9)
    return 0.15 * torch.randn(len(skeleton.group_names), generator=random, dtype=F64)


def test_no_shape_changes_nothing(person: Actor) -> None:
    same = person.resized(torch.zeros(len(person.skeleton.group_names), dtype=F64))
    assert torch.allclose(same.vertices, person.vertices, atol=1e-12)
    assert torch.allclose(same.skeleton.rig.positions, person.skeleton.rig.positions, atol=1e-12)
    assert np.allclose(same.template.bone_rest, person.template.bone_rest, atol=1e-12)


@pytest.mark.parametrize("shape", [(3,), (), (2, 10)])
def test_one_number_a_group(person: Actor, shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"resized: bones have shape .* logarithms of factors"):
        person.resized(torch.zeros(shape, dtype=F64))


def test_bones_grow_by_the_factor_of_their_group(person: Actor) -> None:
    shape = random_shape(person.skeleton)
    resized = person.resized(shape)
    rig, new = person.skeleton.rig, resized.skeleton.rig
    start = [max(p, 0) for p in rig.parents] + list(rig.landmark_joints)

    def lengths(of: Skeleton) -> Tensor:
        ends = torch.cat((of.rig.positions, of.rig.landmark_positions))
        return (ends - of.rig.positions[start]).norm(dim=-1)

    names = person.skeleton.group_names
    groups = [names.index(group) for group in rig.bone_groups[1:]]
    expected = lengths(person.skeleton)[1:] * shape.exp()[groups]
    assert torch.allclose(lengths(resized.skeleton)[1:], expected, atol=1e-12)
    assert new.hinges == rig.hinges


def test_the_new_rig_moves_as_the_old_with_shape(person: Actor) -> None:
    """Up to the lift that keeps the feet on the floor, which the root position absorbs."""
    shape = random_shape(person.skeleton)
    resized = person.resized(shape)
    motion = random_motion(person.skeleton, 5)
    shaped = Motion(motion.translation, motion.rotation, motion.angles, {"bones": shape})
    assert torch.allclose(resized.joints(motion), person.skeleton(shaped).landmarks, atol=1e-12)


def test_feet_stay_on_the_floor(person: Actor) -> None:
    for sign in (-1, 1):
        shape = torch.full((len(person.skeleton.group_names),), sign * 0.2, dtype=F64)
        resized = person.resized(shape)
        low = resized.skeleton.rig.landmark_positions[:, 1].min()
        assert torch.isclose(low, person.skeleton.rig.landmark_positions[:, 1].min())


def test_uniform_growth_scales_the_mesh(person: Actor) -> None:
    factor = 1.2
    shape = torch.full((len(person.skeleton.group_names),), np.log(factor), dtype=F64)
    grown = person.resized(shape)
    assert torch.isfinite(grown.vertices).all()
    moved = grown.vertices - factor * person.vertices
    assert torch.allclose(moved, moved[:1].expand_as(moved), atol=1e-9)


def test_a_longer_thigh_leaves_the_head_its_shape(person: Actor) -> None:
    names = person.skeleton.group_names
    shape = torch.zeros(len(names), dtype=F64)
    shape[names.index("thigh")] = 0.2
    resized = person.resized(shape)
    own = person.template.dense_weights()[:, person.template.bone("head")] > 0.99

    def extent(of: Actor) -> np.ndarray:
        extent: np.ndarray = np.ptp(of.template.vertices[own], axis=0)
        return extent

    girth = float(shape.mean().exp())  # across bones all grow by the mean factor
    assert np.allclose(extent(resized), extent(person) * [girth, 1.0, girth], atol=1e-9)


def test_landmarks_ride_along(person: Actor) -> None:
    resized = person.resized(random_shape(person.skeleton))
    for name, (bone, place) in resized.template.landmarks.items():
        assert bone == person.template.landmarks[name][0]
        index = resized.skeleton.rig.landmarks.index(name)
        expected = resized.skeleton.rig.landmark_positions[index].numpy()
        assert np.allclose(place, expected, atol=1e-9), name


def test_a_resized_actor_can_be_resized_back(person: Actor) -> None:
    shape = random_shape(person.skeleton)
    back = person.resized(shape).resized(-shape)
    assert torch.allclose(back.skeleton.rig.positions, person.skeleton.rig.positions, atol=1e-9)


def test_gradients_that_would_be_lost_are_refused() -> None:
    person = actor()
    bones = torch.zeros(len(person.skeleton.group_names), requires_grad=True)
    with pytest.raises(InputError, match="bones require gradients, which do not reach them"):
        person.resized(bones)
    with torch.no_grad():
        person.resized(bones)
