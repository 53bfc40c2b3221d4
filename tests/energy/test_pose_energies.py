"""Reprojection, 3D joints and priors: zero at truth, derivatives, what they cannot see."""

from dataclasses import replace

import pytest
import torch
from checks import check_energy
from synthetic import actor, cameras, random_motion
from torch import Tensor

from perfcap.actor.anatomy import USUAL, usual_ranges
from perfcap.actor.motion import Motion
from perfcap.actor.rig import with_limits
from perfcap.detect.detections import Detections
from perfcap.detect.retarget import bone_vectors, retarget
from perfcap.energy.joint_position import JointPosition
from perfcap.energy.prior import BoneLengthPrior, PosePrior
from perfcap.energy.reprojection import Reprojection
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.solve.energy import Energy, Step, forward_mode
from perfcap.solve.kernels import GemanMcClure

F64 = torch.float64
ACTOR = actor()
FRAMES = 3


def lenses(views: int, distorted: bool = False) -> Camera:
    camera = cameras(views)
    bend = torch.tensor([0.1, -0.05, 0.003, -0.002, 0.01], dtype=F64)
    return replace(camera, distortion=bend.repeat(views, 1)) if distorted else camera


def detect(motion: Motion, camera: Camera, noise: float = 0.0) -> Detections:
    """What a detector would see; noise in pixels, and a thousandth of it in metres."""
    random = torch.Generator().manual_seed(11)
    joints = ACTOR.joints(motion)
    local = camera.to_camera(joints)
    root = 0.5 * (local[..., 8:9, :] + local[..., 12:13, :])
    pixels = camera.project(joints)
    shape = pixels.shape[:-1]
    return Detections(
        pixels + noise * torch.randn(*shape, 2, generator=random, dtype=F64),
        0.2 + 0.8 * torch.rand(shape, generator=random, dtype=F64),
        local - root + 0.001 * noise * torch.randn(*shape, 3, generator=random, dtype=F64),
        torch.rand(shape[:-1], generator=random, dtype=F64) < 0.7,
    )


def element(motion: Motion, index: int) -> Motion:
    shape = {name: block[index] for name, block in motion.shared.items()}
    return Motion(motion.translation[index], motion.rotation[index], motion.angles[index], shape)


def near(motion: Motion) -> Motion:
    """Somewhere else, so that no residual vanishes."""
    random = torch.Generator().manual_seed(12)
    here = motion.coordinates()
    frame = torch.randn(here.frame.shape, generator=random, dtype=F64)
    shared = torch.randn(here.shared.shape, generator=random, dtype=F64)
    return motion.retract(Step(0.1 * frame, 0.1 * shared))


@pytest.mark.parametrize("kind", [Reprojection, JointPosition])
@pytest.mark.parametrize("views", [1, 3])
def test_zero_at_the_truth(kind: type[Energy], views: int) -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(views, distorted=True)
    energy = kind(ACTOR.landmarks, camera, detect(motion, camera))  # type: ignore[call-arg]
    assert energy(motion) < 1e-18
    assert energy(near(motion)) > 1e-3


@pytest.mark.parametrize("kind", [Reprojection, JointPosition])
@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("shape", [False, True])
def test_closed_form_agrees_with_forward_mode(kind: type[Energy], views: int, shape: bool) -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, (2,), bones=shape)
    camera = lenses(views, distorted=True)
    unit = torch.linspace(0.5, 2, 16, dtype=F64) if kind is JointPosition else 3.0
    energy = kind(  # type: ignore[call-arg]
        ACTOR.landmarks, camera, detect(motion, camera, 2.0), kernel=GemanMcClure(3.0), unit=unit
    )
    state = near(motion)
    closed, exact = energy.linearize(state), forward_mode(energy, state)
    assert torch.allclose(closed.residual.value, exact.residual.value, atol=1e-10)
    assert torch.allclose(closed.frame, exact.frame, atol=1e-9)
    if shape:
        assert closed.shared is not None
        assert exact.shared is not None
        assert torch.allclose(closed.shared, exact.shared, atol=1e-9)


@pytest.mark.parametrize("kind", [Reprojection, JointPosition])
def test_everything_an_energy_promises(kind: type[Energy]) -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES, (2,), bones=True), lenses(2)
    seen = detect(motion, camera, 2.0)
    leaf = seen.joints2d if kind is Reprojection else seen.joints3d
    assert leaf is not None
    leaf = leaf.clone().requires_grad_()
    seen = replace(seen, **{"joints2d" if kind is Reprojection else "joints3d": leaf})
    state = near(motion)

    def pick(index: int) -> tuple[Energy, Motion]:
        assert seen.joints3d is not None
        part = Detections(
            seen.joints2d[index].detach(),
            seen.confidence2d[index],
            seen.joints3d[index].detach(),
            seen.trusted3d[index],
        )
        return kind(ACTOR.landmarks, camera, part), element(state, index)  # type: ignore[call-arg]

    energy = kind(ACTOR.landmarks, camera, seen)  # type: ignore[call-arg]
    check_energy(energy, state, pick=pick, inputs=(leaf,), atol=1e-5)


def test_units_of_reprojection_are_a_view_each() -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(2)
    seen, state = detect(motion, camera), near(motion)
    unit = torch.tensor([2.0, 5.0], dtype=F64)
    scaled = Reprojection(ACTOR.landmarks, camera, seen, unit=unit).residual(state).value
    plain = Reprojection(ACTOR.landmarks, camera, seen).residual(state).value
    factor = 1 / unit.repeat_interleave(16)[:, None]
    assert torch.allclose(scaled, plain * factor)


@pytest.mark.parametrize("uniform", [True, False])
def test_translation_is_eliminated_exactly(uniform: bool) -> None:
    """The energy is the minimum over a translation a frame and view of the one with it."""
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(2)
    seen, state = detect(motion, camera, 5.0), near(motion)
    seen = replace(seen, trusted3d=torch.ones_like(seen.trusted3d))
    unit = torch.ones(16, dtype=F64) if uniform else torch.linspace(0.5, 2, 16, dtype=F64)
    assert seen.joints3d is not None
    free = torch.zeros(FRAMES, 2, 1, 3, dtype=F64, requires_grad=True)

    def with_translation() -> Tensor:
        assert seen.joints3d is not None
        lengths = bone_vectors(ACTOR.joints(state)).norm(dim=-1)[:, None]
        world = retarget(seen.joints3d, lengths) @ camera.rotation
        error = ACTOR.joints(state).unsqueeze(-3) - world - free
        return (error / unit[:, None]).square().sum()

    # quadratic in the translation: one Newton step is the minimum
    gradient = torch.autograd.grad(with_translation(), free)[0]
    with torch.no_grad():
        free -= gradient / (2 * unit.pow(-2).sum())
    least = with_translation()
    assert torch.allclose(torch.autograd.grad(least, free)[0], torch.zeros(()).double(), atol=1e-9)
    energy = JointPosition(ACTOR.landmarks, camera, seen, unit=unit)
    assert torch.allclose(energy(state), least.detach())


def test_moving_the_root_leaves_3d_joints_alone() -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(1)
    energy = JointPosition(ACTOR.landmarks, camera, detect(motion, camera, 5.0))
    moved = replace(motion, translation=motion.translation + torch.tensor([3.0, 1.0, -2.0]))
    assert torch.allclose(energy(moved), energy(motion))
    assert energy.linearize(motion).frame[..., :3].abs().max() < 1e-14


def test_only_directions_of_predicted_bones_count() -> None:
    """An average skeleton whose back does not get shorter when it bends explains the pose."""
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(1)
    seen = detect(motion, camera)
    assert seen.joints3d is not None
    random = torch.Generator().manual_seed(5)
    lengths = 0.1 + torch.rand(16, generator=random, dtype=F64)
    lengths[12] = lengths[8]  # the root stays between the hips
    average = replace(seen, joints3d=retarget(seen.joints3d, lengths))
    energy = JointPosition(ACTOR.landmarks, camera, average)
    assert energy(motion).abs().max() < 1e-20
    state = near(motion)
    assert torch.allclose(energy(state), JointPosition(ACTOR.landmarks, camera, seen)(state))


def test_untrusted_frames_are_left_out() -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(1)
    seen = detect(motion, camera, 5.0)
    trusted = torch.tensor([[True], [False], [True]])
    energy = JointPosition(ACTOR.landmarks, camera, replace(seen, trusted3d=trusted))
    groups = energy.residual(motion).squared_norm()
    assert (groups[1] == 0).all()
    assert (groups[0] > 0).all()


def test_detections_without_depth_are_refused() -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(1)
    flat = replace(detect(motion, camera), joints3d=None)
    with pytest.raises(ValueError, match="needs detections with joints3d"):
        JointPosition(ACTOR.landmarks, camera, flat)


def test_moving_cameras_see_the_same_person() -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(2)
    turn = rotvec_to_matrix(0.1 * torch.arange(FRAMES * 2 * 3, dtype=F64).reshape(FRAMES, 2, 3) / 9)
    moving = Camera(
        camera.intrinsics.expand(FRAMES, 2, 3, 3),
        turn @ camera.rotation,
        camera.translation.expand(FRAMES, 2, 3),
    )
    for kind in (Reprojection, JointPosition):
        energy = kind(ACTOR.landmarks, moving, detect(motion, moving))
        assert energy(motion) < 1e-18
        state = near(motion)
        closed, exact = energy.linearize(state), forward_mode(energy, state)
        assert torch.allclose(closed.frame, exact.frame, atol=1e-9)


def test_pose_prior() -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, (2,))
    mean, deviation = ACTOR.skeleton.rest_angles, torch.linspace(0.5, 2, 27, dtype=F64)
    energy = PosePrior(mean, deviation, 0.3)
    check_energy(energy, motion, pick=lambda i: (energy, element(motion, i)))
    expected = 0.3 * ((motion.angles - mean) / deviation).square().sum((-2, -1))
    assert torch.allclose(energy(motion), expected)
    assert energy(ACTOR.skeleton.rest_motion(FRAMES)) == 0


def test_pose_prior_is_steeper_beyond_what_is_usual() -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, (2,))
    mean = ACTOR.skeleton.rest_angles
    usual = mean - 0.3, mean + 0.2
    energy = PosePrior(mean, 1.5, 0.3, usual, 0.1)
    check_energy(energy, motion, pick=lambda i: (energy, element(motion, i)))
    inside = replace(motion, angles=motion.angles.clamp(*usual))
    torch.testing.assert_close(energy(inside), PosePrior(mean, 1.5, 0.3)(inside))
    edge = replace(motion, angles=usual[1].expand_as(motion.angles))
    past = replace(edge, angles=edge.angles + 0.1)
    rows = energy.residual(past).value - energy.residual(edge).value
    torch.testing.assert_close(rows, torch.full_like(rows, 0.1 / 1.5 + 1))


def test_usual_ranges_lie_within_limits_and_hold_the_rest_pose() -> None:
    rig, skeleton = ACTOR.skeleton.rig, ACTOR.skeleton
    lower, upper = usual_ranges(rig)
    assert (skeleton.lower <= lower).all() and (upper <= skeleton.upper).all()
    assert (lower <= skeleton.rest_angles).all() and (skeleton.rest_angles <= upper).all()
    named = {name.removeprefix("l_").removeprefix("r_") for name in skeleton.angle_names}
    assert set(USUAL) <= named
    own = usual_ranges(with_limits(rig, {"l_hip_rotation": (-0.1, 0.2)}))
    index = skeleton.angle_names.index("l_hip_rotation")
    assert (float(own[0][index]), float(own[1][index])) == (-0.1, 0.2)


def test_bone_length_prior() -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, (2,), bones=True)
    bones = motion.shared["bones"]
    groups = bones.shape[-1]
    energy = BoneLengthPrior(groups, FRAMES, 0.08, 0.06)
    check_energy(energy, motion, pick=lambda i: (energy, element(motion, i)))
    covariance = 0.06**2 * torch.eye(groups, dtype=F64) + 0.08**2
    whitened = torch.linalg.solve(covariance, bones.mT).mT
    expected = (bones * whitened).sum(-1)
    assert torch.allclose(energy(motion), expected)
    with pytest.raises(ValueError, match="shares bones"):
        energy(random_motion(ACTOR.skeleton, FRAMES))


def test_degrees_are_refused() -> None:
    count = len(ACTOR.skeleton.angle_names)
    with pytest.raises(InputError, match="mean has angles of 20, expected radians"):
        PosePrior(torch.full((count,), 20.0, dtype=F64))
    wide = torch.full((count,), 90.0, dtype=F64)
    with pytest.raises(InputError, match="usual has angles of -90, expected radians"):
        PosePrior(torch.zeros(count, dtype=F64), usual=(-wide, wide))
