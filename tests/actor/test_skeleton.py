"""Kinematics: derivatives, invariants, and the compiled twin."""

from dataclasses import replace

import pytest
import torch
from synthetic import random_motion, rest_positions
from torch import Tensor

from perfcap.actor import _kinematics_numba, _kinematics_torch
from perfcap.actor.anatomy import human_rig
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Hinge, Rig, Skeleton
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io import load_actor
from perfcap.solve.energy import Step

F64 = torch.float64


@pytest.fixture(scope="module")
def skeleton() -> Skeleton:
    return Skeleton(human_rig(rest_positions()))


def chain_rig() -> Rig:
    """A root that turns, a shoulder with three hinges out of order, and an elbow."""
    return Rig(
        joints=("base", "shoulder", "elbow"),
        parents=(-1, 0, 1),
        positions=torch.tensor([[0.1, 0.2, 0.3], [0.1, 0.8, 0.3], [0.5, 0.9, 0.2]], dtype=F64),
        hinges=(
            Hinge("bend", "elbow", (0.0, 0.6, 0.8), -1, 1, 0.3),
            Hinge("lift", "shoulder", (0.0, 0.0, 2.0), -1, 1, -0.2),
            Hinge("twist", "base", (0.0, 1.0, 0.0), -1, 1, 0.1),
            Hinge("swing", "shoulder", (1.0, 0.0, 0.0), -1, 1, 0.4),
            Hinge("roll", "shoulder", (0.3, 0.1, 0.9), -1, 1),
        ),
        landmarks=("hand", "hip"),
        landmark_joints=(2, 0),
        landmark_positions=torch.tensor([[0.9, 0.8, 0.1], [0.2, 0.2, 0.3]], dtype=F64),
    )


def test_rest_pose_is_the_rig(skeleton: Skeleton) -> None:
    for one in (skeleton, Skeleton(chain_rig())):
        pose = one(one.rest_motion(2))
        assert torch.allclose(pose.position, one.rig.positions.expand_as(pose.position), atol=1e-14)
        marks = one.rig.landmark_positions.expand_as(pose.landmarks)
        assert torch.allclose(pose.landmarks, marks, atol=1e-14)
        assert torch.allclose(pose.rotation, torch.eye(3, dtype=F64).expand_as(pose.rotation))


@pytest.mark.parametrize("count", [1, 26, 28])
def test_motions_of_another_number_of_angles_are_refused(skeleton: Skeleton, count: int) -> None:
    """A compiled loop would read the angles of the next frame, or what lies behind the last."""
    motion = random_motion(skeleton, 3)
    other = replace(motion, angles=torch.cat((motion.angles, motion.angles), -1)[..., :count])
    for place in (skeleton, skeleton.linearize):
        with pytest.raises(InputError, match=rf"angles \(3, {count}\), expected .* 27\)"):
            place(other)


def test_hinges_turn_in_order_about_carried_axes() -> None:
    """The definition, spelled out for one chain by hand."""
    rig = chain_rig()
    angles = torch.tensor([0.5, 0.2, -0.6, 0.9, 0.4], dtype=F64)
    root = torch.tensor([0.3, -0.2, 0.7], dtype=F64)

    def turn(hinge: int, angle: float | Tensor) -> Tensor:
        axis = torch.nn.functional.normalize(torch.tensor(rig.hinges[hinge].axis, dtype=F64), dim=0)
        return rotvec_to_matrix(angle * axis)

    def joint(*hinges: int) -> Tensor:
        now = rest = torch.eye(3, dtype=F64)
        for hinge in hinges:
            now = now @ turn(hinge, angles[hinge])
            rest = rest @ turn(hinge, rig.hinges[hinge].rest)
        return now @ rest.T

    base = rotvec_to_matrix(root) @ joint(2)
    shoulder = base @ joint(1, 3, 4)
    elbow = shoulder @ joint(0)
    at, hand = rig.positions, rig.landmark_positions[0]
    start = torch.tensor([1.0, 2.0, 3.0], dtype=F64)
    expected = start + base @ (at[1] - at[0]) + shoulder @ (at[2] - at[1]) + elbow @ (hand - at[2])
    pose = Skeleton(rig)(Motion(start[None], root[None], angles[None]))
    assert torch.allclose(pose.landmarks[0, 0], expected, atol=1e-14)
    assert torch.allclose(pose.rotation[0, 2], elbow, atol=1e-14)


def test_bones_keep_their_lengths(skeleton: Skeleton) -> None:
    rig = skeleton.rig
    pose = skeleton(random_motion(skeleton, 50))
    start = [max(p, 0) for p in rig.parents] + list(rig.landmark_joints)
    ends = torch.cat((pose.position, pose.landmarks), -2)
    rest = torch.cat((rig.positions, rig.landmark_positions))
    found = (ends - pose.position[:, start]).norm(dim=-1)
    assert torch.allclose(found, (rest - rig.positions[start]).norm(dim=-1).expand_as(found))
    identity = pose.rotation @ pose.rotation.mT
    assert torch.allclose(identity, torch.eye(3, dtype=F64).expand_as(identity), atol=1e-13)


def test_shape_scales_bones_by_group(skeleton: Skeleton) -> None:
    rig = skeleton.rig
    motion = random_motion(skeleton, 3, (2,), bones=True)
    pose = skeleton(motion)
    upper_arm = (pose.position[..., rig.joints.index("l_elbow"), :]
                 - pose.position[..., rig.joints.index("l_shoulder"), :]).norm(dim=-1)  # fmt: skip
    factor = motion.shared["bones"][:, skeleton.group_names.index("upper_arm")].exp()
    assert torch.allclose(upper_arm, 0.29 * factor[:, None].expand(2, 3))


@pytest.mark.parametrize("shape", [False, True])
@pytest.mark.parametrize("human", [False, True])
def test_closed_form_is_the_derivative(skeleton: Skeleton, human: bool, shape: bool) -> None:
    one = skeleton if human else Skeleton(chain_rig())
    motion = random_motion(one, 3, (2,), bones=shape)
    landmarks, frame, shared = one.linearize(motion)
    assert torch.allclose(landmarks, one(motion).landmarks, atol=1e-14)
    exact = forward_mode(one, motion)
    assert torch.allclose(frame, exact[..., : motion.frame_dim], atol=1e-12)
    if shape:
        assert shared is not None
        assert torch.allclose(shared, exact[..., motion.frame_dim :], atol=1e-12)
    else:
        assert shared is None


def forward_mode(skeleton: Skeleton, motion: Motion) -> Tensor:
    """Derivative in one tangent shared by all frames, (*b, F, L, 3, D + S)."""

    def landmarks(tangent: Tensor) -> Tensor:
        lead = motion.angles.shape[:-1]
        frame = tangent[: motion.frame_dim].expand(*lead, motion.frame_dim)
        shared = tangent[motion.frame_dim :].expand(
            *lead[:-1], motion.coordinates().shared.shape[-1]
        )
        marks: Tensor = skeleton(motion.retract(Step(frame, shared))).landmarks
        return marks

    return torch.func.jacfwd(landmarks)(
        motion.angles.new_zeros(motion.frame_dim + motion.coordinates().shared.shape[-1])
    )


def test_closed_form_agrees_with_central_differences(skeleton: Skeleton) -> None:
    motion, step = random_motion(skeleton, 2), 1e-6
    frame = skeleton.linearize(motion)[1]
    for k in range(motion.frame_dim):
        move = torch.zeros(2, motion.frame_dim, dtype=F64)
        move[:, k] = step
        none = torch.zeros(0, dtype=F64)
        ahead = skeleton(motion.retract(Step(move, none))).landmarks
        back = skeleton(motion.retract(Step(-move, none))).landmarks
        assert torch.allclose(frame[..., k], (ahead - back) / (2 * step), atol=1e-8)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("shape", [False, True])
@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_compiled_loops_are_the_plain_twin(
    dtype: torch.dtype, shape: bool, batch: tuple[int, ...]
) -> None:
    tolerance = 20 * torch.finfo(dtype).eps
    for rig in (human_rig(rest_positions()), chain_rig()):
        one = Skeleton(rig).to(dtype)
        motion = random_motion(one, 4, batch, bones=shape)
        compiled = _kinematics_numba.place(one.tree, motion)
        plain = _kinematics_torch.place(one.tree, motion)
        for name in ("rotation", "position", "landmarks"):
            found, expected = getattr(compiled, name), getattr(plain, name)
            assert found.dtype == dtype
            assert found.shape == expected.shape
            assert (found - expected).abs().max() < tolerance
        pairs = zip(
            _kinematics_numba.linearize(one.tree, motion),
            _kinematics_torch.linearize(one.tree, motion),
            strict=True,
        )
        for found, expected in pairs:
            assert (found is None) == (expected is None)
            if found is not None and expected is not None:
                assert found.dtype == dtype
                assert found.shape == expected.shape
                assert (found - expected).abs().max() < tolerance


def test_no_frames_give_no_poses(skeleton: Skeleton) -> None:
    motion = random_motion(skeleton, 0)
    assert skeleton(motion).landmarks.shape == (0, 16, 3)
    assert skeleton.linearize(motion)[1].shape == (0, 16, 3, 33)


def test_batch_equals_loop(skeleton: Skeleton) -> None:
    motion = random_motion(skeleton, 3, (2,), bones=True)
    landmarks, frame, shared = skeleton.linearize(motion)
    assert shared is not None
    for b in range(2):
        single = Motion(
            motion.translation[b],
            motion.rotation[b],
            motion.angles[b],
            {"bones": motion.shared["bones"][b]},
        )
        one = skeleton.linearize(single)
        assert one[2] is not None
        assert torch.equal(landmarks[b], one[0])
        assert torch.equal(frame[b], one[1])
        assert torch.equal(shared[b], one[2])


def test_memory_layout_does_not_matter(skeleton: Skeleton) -> None:
    motion = random_motion(skeleton, 4)
    strided = Motion(
        motion.translation.repeat(1, 2)[:, :3],
        motion.rotation[:1].expand(4, 3),
        motion.angles.T.contiguous().T,
    )
    dense = replace(strided, rotation=motion.rotation[:1].repeat(4, 1))
    assert torch.equal(skeleton(strided).landmarks, skeleton(dense).landmarks)


def test_gradients_reach_every_unknown(skeleton: Skeleton) -> None:
    motion = random_motion(skeleton, 1, bones=True)
    leaves = [motion.translation, motion.rotation, motion.angles, motion.shared["bones"]]
    inputs = [leaf.clone().requires_grad_() for leaf in leaves if leaf is not None]

    def landmarks(*parts: Tensor) -> Tensor:
        marks: Tensor = skeleton(Motion(*parts[:3], {"bones": parts[3]})).landmarks
        return marks

    assert torch.autograd.gradcheck(landmarks, inputs)
    with torch.no_grad():
        plain = landmarks(*inputs)
    assert torch.allclose(plain, skeleton(motion).landmarks, atol=1e-14)


def test_transforms_compose(skeleton: Skeleton) -> None:
    motion = random_motion(skeleton, 3, (2,))

    def landmarks(angles: Tensor, rotation: Tensor, translation: Tensor) -> Tensor:
        marks: Tensor = skeleton(Motion(translation, rotation, angles)).landmarks
        return marks

    parts = (motion.angles, motion.rotation, motion.translation)
    mapped = torch.func.vmap(landmarks)(*parts)
    assert torch.allclose(mapped, skeleton(motion).landmarks, atol=1e-13)
    reverse = torch.func.vmap(torch.func.jacrev(landmarks))(*parts)
    forward = torch.func.vmap(torch.func.jacfwd(landmarks))(*parts)
    assert torch.allclose(reverse, forward, atol=1e-12)


def test_second_derivatives_are_right(skeleton: Skeleton) -> None:
    motion = random_motion(skeleton, 1)
    angles = motion.angles[:, 7:11].clone().requires_grad_()

    def height(some: Tensor) -> Tensor:
        every = torch.cat((motion.angles[:, :7], some, motion.angles[:, 11:]), -1)
        return skeleton(replace(motion, angles=every)).landmarks[..., 1].square().sum()

    assert torch.autograd.gradgradcheck(height, angles)


def test_bounds_are_infinite_for_the_root(skeleton: Skeleton) -> None:
    lower, upper = skeleton.bounds
    assert lower.shape == upper.shape == (33,)
    assert torch.isinf(lower[:6]).all()
    assert torch.equal(upper[6:], skeleton.upper)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parents": (-1, 2, 1)}, "follow their parents"),
        ({"parents": (-1, -1, 0)}, "one root"),
        ({"joints": ("base", "arm", "elbow")}, "hinges on shoulder"),
        ({"positions": torch.full((3, 3), torch.nan)}, "not finite"),
    ],
)
def test_broken_rigs_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(chain_rig(), **change)  # type: ignore[arg-type]


def test_bones_that_are_learned_in_place_are_seen() -> None:
    """What a motion keeps of the kinematics belongs to the bones that made it."""
    skeleton = Skeleton(human_rig(rest_positions()))
    motion = random_motion(skeleton, 2)
    before = skeleton.linearize(motion)
    assert skeleton.linearize(motion)[0] is before[0]
    with torch.no_grad():
        skeleton.tree.bone_vectors *= 1.1
    after = skeleton.linearize(motion)
    torch.testing.assert_close(after[0], skeleton(motion).landmarks)
    assert not torch.allclose(after[0], before[0])
    skeleton.tree.bone_vectors = 1.2 * skeleton.tree.bone_vectors
    torch.testing.assert_close(skeleton.linearize(motion)[0], skeleton(motion).landmarks)


def test_bones_of_other_groups_are_refused() -> None:
    """Too many were cut off, too few ended in a traceback."""
    sam = load_actor("sam")
    count, rest = len(sam.skeleton.group_names), sam.skeleton.rest_motion(2)
    for shape in ((count + 1,), (count - 1,), (2, count)):
        wrong = replace(rest, shared={"bones": torch.zeros(shape, dtype=torch.float64)})
        with pytest.raises(InputError, match=rf"expected \(\*b, {count}\)"):
            sam.joints(wrong)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"landmark_joints": (1, 9)}, r"landmarks on joints \(1, 9\)"),
        ({"landmark_joints": (1, -1)}, r"landmarks on joints \(1, -1\)"),
        ({"landmark_joints": (1,)}, "2 landmarks, on 1 joints"),
        ({"landmark_positions": torch.zeros(3, 3)}, r"at positions \(3, 3\)"),
        ({"positions": torch.zeros(2, 3)}, r"3 joints, 3 parents and positions \(2, 3\)"),
        ({"parents": (-1, 0)}, "3 joints, 2 parents"),
        ({"joints": ("base", "elbow", "elbow"), "hinges": ()}, "joints of the same name"),
        ({"bone_groups": ("all",)}, "1 bone groups"),
        ({"roles": (7,)}, r"roles \(7,\)"),
    ],
)
def test_rigs_whose_numbers_do_not_fit_each_other(change, message) -> None:
    """A landmark of no joint was looked for without an end."""
    with pytest.raises(InputError, match=message):
        replace(chain_rig(), **change)


def test_a_hinge_about_nothing() -> None:
    for axis in ((0.0, 0.0, 0.0), (torch.nan, 0.0, 1.0)):
        with pytest.raises(InputError, match="about which nothing turns"):
            Hinge("bend", "elbow", axis, -1, 1)


def test_a_motion_on_another_device(skeleton: Skeleton) -> None:
    """It ended in a traceback."""
    nowhere = random_motion(skeleton, 2).map(lambda part: part.to("meta"))
    for method in (skeleton.forward, skeleton.linearize):
        with pytest.raises(InputError, match="motion is on meta, the skeleton on cpu"):
            method(nowhere)
