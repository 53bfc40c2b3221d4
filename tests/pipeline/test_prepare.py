"""Detections on their way to the solver: the actor's lengths, and the gate for wrong 3D poses."""

from dataclasses import replace

import pytest
import torch
from synthetic import actor, cameras
from takes import make_take, without

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import bone_vectors, mid_hip, retarget
from perfcap.geometry.camera import Camera
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import Prepared
from perfcap.pipeline.prepare import prepare as prepare_frames

HIPS, HEAD = [LANDMARKS.index(n) for n in ("r_hip", "l_hip")], LANDMARKS.index("head_top")


def prepare(
    person: Actor, views: Camera, detections: Detections, gate: float = PoseConfig().position.gate
) -> Prepared:
    config = PoseConfig()
    config = replace(config, position=replace(config.position, gate=gate))
    return prepare_frames(FrameProblem.of(person, views, detections, config))


def test_retargeting_sets_lengths_and_keeps_directions() -> None:
    random = torch.Generator().manual_seed(0)
    points = torch.randn(3, 2, 16, 3, generator=random, dtype=torch.float64)
    lengths = bone_vectors(actor().skeleton.rest_landmarks).norm(dim=-1)
    moved = retarget(points, lengths)
    before, after = bone_vectors(points), bone_vectors(moved)
    torch.testing.assert_close(after.norm(dim=-1)[..., 2:8], lengths[2:8].expand(3, 2, 6))
    limbs = [i for i in range(16) if i not in HIPS]
    cosine = torch.cosine_similarity(before, after, dim=-1)[..., [i for i in limbs if i != 1]]
    torch.testing.assert_close(cosine, torch.ones_like(cosine))
    torch.testing.assert_close(retarget(10 * points, lengths), moved)


def test_retargeting_one_s_own_pose_changes_little() -> None:
    take = make_take(20)
    lengths = bone_vectors(take.actor.skeleton.rest_landmarks).norm(dim=-1)
    joints3d = take.detections.joints3d
    assert joints3d is not None
    moved = retarget(joints3d, lengths)
    assert (moved - joints3d).norm(dim=-1).max() < 0.03  # the spine bends


def test_retargeted_poses_are_about_the_middle_of_the_hips() -> None:
    """What ``JointPosition`` and the lift both take for granted."""
    take = make_take(8)
    joints3d = take.detections.joints3d
    assert joints3d is not None
    lengths = bone_vectors(take.actor.skeleton.rest_landmarks).norm(dim=-1)
    assert mid_hip(retarget(1.2 * joints3d, lengths)).abs().max() < 1e-12


def test_exact_poses_pass_the_gate_and_are_lifted_to_their_place() -> None:
    take = make_take(20, views=2)
    prepared = prepare(take.actor, take.cameras, take.detections)
    assert prepared.detections.trusted3d.all()
    assert prepared.error3d is not None and prepared.lifted is not None
    assert prepared.error3d.shape == (20, 2) and prepared.error3d.max() < 0.1
    truth = take.actor.joints(take.truth)[:, None]
    assert (prepared.lifted - truth).norm(dim=-1).mean() < 0.05


def test_a_shift_in_the_image_is_no_reason_for_distrust_but_another_pose_is() -> None:
    take = make_take(20)
    shifted = replace(take.detections, joints2d=take.detections.joints2d + 40)
    assert prepare(take.actor, take.cameras, shifted).detections.trusted3d.all()
    joints3d = take.detections.joints3d
    assert joints3d is not None
    wrong = joints3d.clone()
    wrong[7] = wrong[7] * torch.tensor([1.0, -1.0, 1.0], dtype=torch.float64)  # upside down
    wrong[12] = wrong[12].roll(5, -2)  # joints of other names
    prepared = prepare(take.actor, take.cameras, replace(take.detections, joints3d=wrong))
    assert torch.where(~prepared.detections.trusted3d[:, 0])[0].tolist() == [7, 12]


def test_the_gate_is_a_mean_distance_in_head_lengths() -> None:
    """One joint of sixteen, off by d head lengths in the image, counts d / 16."""
    person = actor()
    take = make_take(3, actor=person)
    head = bone_vectors(person.skeleton.rest_landmarks).norm(dim=-1)[HEAD]
    depth = take.cameras.to_camera(person.joints(take.truth))[:, 0, 8:13:4, 2].mean(-1)
    focal = take.cameras.intrinsics[0, 0, 0]
    plain = prepare(person, take.cameras, take.detections).error3d
    pixels = take.detections.joints2d.clone()
    pixels[:, 0, 4, 0] += 2 * focal * head / depth  # two head lengths at that depth
    moved = prepare(person, take.cameras, replace(take.detections, joints2d=pixels)).error3d
    assert plain is not None and moved is not None
    torch.testing.assert_close(moved - plain, torch.full_like(plain, 2 / 16), rtol=0.25, atol=0.0)


def test_a_tighter_gate_trusts_less_and_never_more() -> None:
    take = make_take(12)
    assert not prepare(take.actor, take.cameras, take.detections, 1e-9).detections.trusted3d.any()
    none = without(take.detections, slice(3, 6))
    trusted = prepare(take.actor, take.cameras, none, 1e9).detections.trusted3d[:, 0]
    assert torch.where(~trusted)[0].tolist() == [3, 4, 5]


def test_a_wrong_head_does_not_change_the_unit() -> None:
    take = make_take(5)
    joints3d = take.detections.joints3d
    assert joints3d is not None
    big = joints3d.clone()
    neck = LANDMARKS.index("neck")
    big[..., HEAD, :] = big[..., neck, :] + 20 * (big[..., HEAD, :] - big[..., neck, :])
    error = [
        prepare(take.actor, take.cameras, replace(take.detections, joints3d=j)).error3d
        for j in (joints3d, big)
    ]
    assert error[0] is not None and error[1] is not None
    torch.testing.assert_close(error[0], error[1])


def test_no_3d_no_gate() -> None:
    take = make_take(4, lifted=False)
    prepared = prepare(take.actor, take.cameras, take.detections)
    assert prepared.lifted is None and prepared.error3d is None
    assert prepared.detections is take.detections


@pytest.mark.parametrize("frames", [slice(0, 2), slice(3, 4)])
def test_parts_of_prepared_detections(frames: slice) -> None:
    take = make_take(5)
    prepared = prepare(take.actor, take.cameras, take.detections)
    again = prepare(take.actor, take.cameras.frames(frames), take.detections.frames(frames))
    part = prepared.frames(frames)
    assert part.lifted is not None and again.lifted is not None
    torch.testing.assert_close(part.lifted, again.lifted)
    assert cameras(1).views == part.detections.views
