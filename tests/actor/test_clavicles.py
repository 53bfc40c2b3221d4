"""Clavicles that turn as arms are lifted: derivatives, invariants, and rigs without any."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from synthetic import clavicled, random_motion, template
from test_skeleton import forward_mode
from torch import Tensor

from perfcap.actor import _kinematics_numba, _kinematics_torch
from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import CLAVICLE_RANGE, CLAVICLES, JOINTS
from perfcap.actor.bone_owners import clavicle_bones
from perfcap.actor.joint_angles import joint_angles
from perfcap.actor.motion import Motion
from perfcap.actor.points import Landmarks
from perfcap.actor.skeleton import Skeleton
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.errors import InputError
from perfcap.solve.energy import Step
from perfcap.solve.second_order import twice_differentiated

F64 = torch.float64
ACTOR = Actor(clavicled())
SKELETON = ACTOR.skeleton
SPINE, SHOULDER, CLAVICLE = 1, JOINTS.index("l_shoulder"), len(JOINTS)


def lifted(skeleton: Skeleton, elevation: float, horizontal: float = 0.0) -> Motion:
    """Both arms lifted by some degrees."""
    rest = skeleton.rest_motion()
    angles = rest.angles.clone()
    for side in "lr":
        for kind, value in (("elevation", elevation), ("horizontal", horizontal)):
            index = skeleton.angle_names.index(f"{side}_shoulder_{kind}")
            angles[:, index] = math.radians(value)
    return replace(rest, angles=angles)


def test_clavicles_are_joints_behind_the_sixteen() -> None:
    assert SKELETON.rig.joints == (*JOINTS, *CLAVICLES)
    assert SKELETON.rig.without_clavicles == (*range(len(JOINTS)), SPINE, SPINE)
    pose = SKELETON(SKELETON.rest_motion())
    assert torch.allclose(pose.position[0], SKELETON.rest_positions, atol=1e-14)
    assert torch.allclose(pose.rotation, torch.eye(3, dtype=F64).expand_as(pose.rotation))


def test_the_shoulder_is_the_clavicle_s_end_and_turns_as_without() -> None:
    plain = Actor(replace(clavicled(), joint_bones={})).skeleton
    motion = random_motion(SKELETON, 20)
    pose, before = SKELETON(motion), plain(motion)
    assert torch.allclose(pose.rotation[:, : len(JOINTS)], before.rotation, atol=1e-14)
    rest = SKELETON.rest_positions
    end = (
        pose.rotation[:, CLAVICLE] @ (rest[SHOULDER] - rest[CLAVICLE]) + pose.position[:, CLAVICLE]
    )
    assert torch.allclose(pose.position[:, SHOULDER], end, atol=1e-14)
    arms = ("shoulder", "elbow", "wrist")
    still = [joint for joint, name in enumerate(JOINTS) if not name.endswith(arms)]
    assert torch.allclose(pose.position[:, still], before.position[:, still], atol=1e-14)
    shift = pose.position[:, : len(JOINTS)] - before.position
    for joint in ("l_elbow", "l_wrist"):
        assert torch.allclose(shift[:, JOINTS.index(joint)], shift[:, SHOULDER], atol=1e-14)


def test_a_clavicle_rises_by_the_published_range_and_little_at_first() -> None:
    def turn(elevation: float, horizontal: float = 0.0) -> float:
        return float(SKELETON.tree.clavicles(lifted(SKELETON, elevation, horizontal).angles)[0, 0])

    hanging = turn(0)
    assert math.degrees(turn(180) - hanging) == pytest.approx(CLAVICLE_RANGE)
    share = [(turn(e) - hanging) / (turn(120) - hanging) for e in (30, 60, 90)]
    # Scibek and Carcia 2012, of the rise to 120 degrees: 2, 21 and 54 %
    assert np.allclose(share, (0.02, 0.21, 0.54), atol=0.11)
    assert turn(60, 90) == pytest.approx(turn(90), abs=1e-12)  # an arm that is level, anywhere
    low, high = (SKELETON(lifted(SKELETON, e)).position[0, SHOULDER] for e in (0.0, 170.0))
    assert 0.02 < float((high - low)[1]) < 0.05
    sides = SKELETON(lifted(SKELETON, 150)).position[0]
    right = sides[JOINTS.index("r_shoulder")] * torch.tensor([-1.0, 1.0, 1.0])
    assert torch.allclose(sides[SHOULDER], right, atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("bones", [False, True])
def test_closed_form_is_the_derivative(bones: bool) -> None:
    motion = random_motion(SKELETON, 3, (2,), bones=bones)
    landmarks, frame, shared = SKELETON.linearize(motion)
    assert torch.allclose(landmarks, SKELETON(motion).landmarks, atol=1e-14)
    exact = forward_mode(SKELETON, motion)
    assert torch.allclose(frame, exact[..., : motion.frame_dim], atol=1e-12)
    if shared is not None:
        assert torch.allclose(shared, exact[..., motion.frame_dim :], atol=1e-12)


def test_derivative_agrees_with_differences() -> None:
    motion, step = random_motion(SKELETON, 2), 1e-6
    points = surface_points()
    frames = SKELETON.linearize(motion)[1], points.linearize(motion)[1]
    for k in range(motion.frame_dim):
        move = torch.zeros(2, motion.frame_dim, dtype=F64)
        move[:, k] = step
        ahead, back = (motion.retract(Step(m, torch.zeros(0, dtype=F64))) for m in (move, -move))
        pairs = (ACTOR.joints, points), frames
        for place, frame in zip(*pairs, strict=True):
            assert torch.allclose(
                frame[..., k], (place(ahead) - place(back)) / (2 * step), atol=1e-7
            )


@pytest.mark.parametrize("bones", [False, True])
def test_second_derivative_in_closed_form(bones: bool) -> None:
    landmarks = Landmarks(SKELETON)
    motion = random_motion(SKELETON, 2, bones=bones)
    linearized = landmarks.linearize(motion)
    pull = torch.linspace(-1, 1, linearized[0].numel(), dtype=F64).view_as(linearized[0])
    closed = landmarks.curvature(motion, linearized, pull)
    exact = twice_differentiated(landmarks, motion, pull)
    assert torch.allclose(closed.frame, exact.frame, atol=1e-10)
    if bones:
        assert closed.border is not None and exact.border is not None
        assert closed.shared is not None and exact.shared is not None
        assert torch.allclose(closed.border, exact.border, atol=1e-10)
        assert torch.allclose(closed.shared, exact.shared, atol=1e-10)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("batch", [(), (2,)])
def test_compiled_loops_are_the_plain_twin(dtype: torch.dtype, batch: tuple[int, ...]) -> None:
    tolerance = 20 * torch.finfo(dtype).eps
    one = Skeleton(SKELETON.rig).to(dtype)
    motion = random_motion(one, 4, batch, bones=True)
    compiled, plain = (
        twin.place(one.tree, motion) for twin in (_kinematics_numba, _kinematics_torch)
    )
    for name in ("rotation", "position", "landmarks"):
        assert (getattr(compiled, name) - getattr(plain, name)).abs().max() < tolerance
    pairs = (twin.linearize(one.tree, motion) for twin in (_kinematics_numba, _kinematics_torch))
    for found, expected in zip(*pairs, strict=True):
        assert found is not None and expected is not None
        assert (found - expected).abs().max() < tolerance


def surface_points() -> SkinnedPoints:
    """Every vertex of the arms and the trunk."""
    corners = torch.arange(len(ACTOR.vertices))[:, None]
    return SkinnedPoints(ACTOR, corners, torch.ones_like(corners, dtype=F64))


def test_points_of_the_surface_are_the_surface_and_have_its_derivative() -> None:
    motion = random_motion(SKELETON, 3)
    points = surface_points()
    found, frame, _ = points.linearize(motion)
    assert torch.allclose(found, ACTOR.surface(motion), atol=1e-12)
    moving = motion.angles.clone().requires_grad_()
    tracked = replace(motion, angles=moving)
    other, plain, _ = points.linearize(tracked)
    assert torch.allclose(frame, plain, atol=1e-12) and torch.allclose(found, other, atol=1e-12)
    (gradient,) = torch.autograd.grad(points(tracked)[..., 1].sum(), moving)
    assert torch.allclose(gradient, frame[..., 1, 6:].sum(-2), atol=1e-10)


def test_gradients_and_maps() -> None:
    motion = random_motion(SKELETON, 2, (2,))

    def landmarks(angles: Tensor) -> Tensor:
        marks: Tensor = SKELETON(
            Motion(motion.translation[0], motion.rotation[0], angles)
        ).landmarks
        return marks

    assert torch.autograd.gradcheck(landmarks, motion.angles[0].clone().requires_grad_())
    mapped = torch.func.vmap(landmarks)(motion.angles)
    assert torch.allclose(mapped[1], landmarks(motion.angles[1]), atol=1e-13)
    whole = SKELETON.linearize(motion)[1]
    for b in range(2):
        one = Motion(motion.translation[b], motion.rotation[b], motion.angles[b])
        assert torch.equal(whole[b], SKELETON.linearize(one)[1])


def test_bones_of_the_rig_move_as_one_chain() -> None:
    """An exported animation plays on bones of fixed lengths."""
    motion = random_motion(SKELETON, 5)
    moved, rig = ACTOR.bone_transforms(motion), ACTOR.template
    rest = torch.tensor(rig.bone_rest[:, :3, 3])
    for bone, parent in enumerate(rig.bone_parents.tolist()):
        if parent >= 0:
            ends = [moved[:, b, :3, :3] @ rest[bone] + moved[:, b, :3, 3] for b in (bone, parent)]
            assert torch.allclose(*ends, atol=1e-12), rig.bone_names[bone]


def test_bones_of_a_batch_are_those_of_each() -> None:
    motion = random_motion(SKELETON, 5)
    both = [motion, replace(motion, angles=0.5 * motion.angles)]
    moved = ACTOR.bone_transforms(Motion.stack(both))
    for one, of_batch in zip(both, moved, strict=True):
        assert torch.allclose(ACTOR.bone_transforms(one), of_batch, rtol=0, atol=1e-14)


def test_angles_are_found_from_the_sixteen_rotations() -> None:
    inside = SKELETON.rest_motion(1)
    motion = replace(inside, angles=inside.angles + 0.1 * torch.rand(1, 27, dtype=F64))
    rotation = SKELETON(motion).rotation
    found = joint_angles(SKELETON, rotation[:, : len(JOINTS)])
    assert torch.equal(found, joint_angles(SKELETON, rotation))
    again = SKELETON(replace(motion, angles=found)).rotation
    assert torch.allclose(again[:, SHOULDER], rotation[:, SHOULDER], atol=1e-6)


def test_resized_actors_keep_their_clavicles() -> None:
    bones = torch.zeros(len(SKELETON.group_names), dtype=F64)
    bones[SKELETON.group_names.index("shoulders")] = 0.2
    wide = ACTOR.resized(bones)
    rest = wide.skeleton.rest_positions
    before = SKELETON.rest_positions
    assert wide.skeleton.rig.joints == SKELETON.rig.joints
    lengths = [(p[SHOULDER] - p[CLAVICLE]).norm() for p in (rest, before)]
    assert float(lengths[0] / lengths[1]) == pytest.approx(math.exp(0.2), abs=1e-9)
    motion = random_motion(SKELETON, 2, seed=1)
    known = replace(motion, shared={"bones": bones})
    assert torch.allclose(wide.joints(motion), SKELETON(known).landmarks, atol=1e-9)


def test_rigs_without_clavicles_are_as_they_were() -> None:
    plain = Actor(template())
    assert plain.skeleton.rig.joints == JOINTS and not plain.skeleton.rig.clavicles
    assert not plain.skeleton.tree.clavicles.count
    assert torch.equal(plain.skeleton.tree.order, torch.arange(len(JOINTS) + 16))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint": "l_elbow"}, "not its last joints"),
        ({"carried": "head"}, "same parent"),
        ({"carried": "nose"}, "same parent"),
        ({"lifts": ("l_shoulder_elevation", "l_elbow_flexion")}, "two of its hinges"),
        ({"lifts": ("up", "down")}, "two of its hinges"),
    ],
)
def test_broken_clavicles_are_refused(change: dict[str, object], message: str) -> None:
    rig = SKELETON.rig
    broken = (replace(rig.clavicles[0], **change), rig.clavicles[1])  # type: ignore[arg-type]
    with pytest.raises(InputError, match=message):
        replace(rig, clavicles=broken)
    hung = (*rig.parents[:CLAVICLE], SPINE, CLAVICLE)
    with pytest.raises(InputError, match="carry others"):
        replace(rig, parents=hung)


def test_what_is_a_clavicle() -> None:
    rig = ACTOR.template
    parents, places, joints = rig.bone_parents.tolist(), rig.bone_rest[:, :3, 3], rig.joint_bones
    found = clavicle_bones(parents, places, joints)
    assert {rig.bone_names[bone] for bone in found.values()} == {"l_collar", "r_collar"}
    assert clavicle_bones(parents, places, {}) == {}
    high = places.copy()
    high[found["l_clavicle"]] = high[joints["l_shoulder"]] - (0.0, 0.2, 0.0)
    assert clavicle_bones(parents, high, joints) == {}  # it does not reach sideways
    straight = list(parents)
    straight[joints["r_shoulder"]] = joints["spine"]
    assert clavicle_bones(straight, places, joints) == {}  # one side alone
