"""Chosen points are those of the surface, and their closed-form derivative is true."""

import math
from dataclasses import replace

import pytest
import torch
from synthetic import actor, random_motion
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.surface_points import LimbPoints, SkinnedPoints
from perfcap.errors import InputError
from perfcap.solve.energy import Step

F64 = torch.float64
ACTOR = actor()
COUNT = len(ACTOR.vertices)
BATCH, FRAMES, POINTS = 2, 3, 20


def choose(*lead: int, corners: int = 2, seed: int = 0) -> tuple[Tensor, Tensor]:
    random = torch.Generator().manual_seed(seed)
    index = torch.randint(COUNT, (*lead, POINTS, corners), generator=random)
    weights = torch.rand(*lead, POINTS, corners, generator=random, dtype=F64)
    return index, weights / weights.sum(-1, keepdim=True)


def on_surface(motion: Motion, corners: Tensor, weights: Tensor) -> Tensor:
    """The definition: pose everything, then choose."""
    surface = ACTOR.surface(motion)
    flat = corners.flatten(-2).unsqueeze(-1).expand(*corners.shape[:-2], -1, 3)
    chosen = surface.gather(-2, flat).reshape(*corners.shape, 3)
    return (weights.unsqueeze(-1) * chosen).sum(-2)


def watched(motion: Motion) -> Motion:
    """The same motion with a gradient, so that the plain twin answers."""
    return replace(motion, angles=motion.angles.clone().requires_grad_())


def poses(kind: str) -> Motion:
    motion = random_motion(ACTOR.skeleton, FRAMES, (BATCH,), seed=3)
    if kind == "far":
        return replace(motion, translation=motion.translation + torch.tensor([30.0, -20.0, 40.0]))
    if kind == "half turn":
        axis = torch.nn.functional.normalize(motion.rotation, dim=-1)
        return replace(motion, rotation=math.pi * axis)
    if kind == "twisted":  # neighbouring bones all but opposite, far outside the limits
        turned = torch.where(torch.arange(motion.angles.shape[-1]) % 3 == 0, 3.13, 0.4)
        return replace(motion, angles=motion.angles.sign() * turned)
    if kind == "rest":
        rest = ACTOR.skeleton.rest_motion(FRAMES)
        parts = (rest.translation, rest.rotation, rest.angles)
        return Motion(*(part.expand(BATCH, *part.shape).contiguous() for part in parts))
    return motion


KINDS = ["random", "far", "half turn", "twisted", "rest"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("corners", [1, 3])
def test_equals_the_surface(kind: str, corners: int) -> None:
    motion, chosen = poses(kind), choose(BATCH, FRAMES, corners=corners)
    points, expected = SkinnedPoints(ACTOR, *chosen), on_surface(motion, *chosen)
    close = {"rtol": 0, "atol": 1e-12 * (100 if kind == "far" else 1)}
    torch.testing.assert_close(points(motion), expected, **close)
    torch.testing.assert_close(points.linearize(motion)[0], expected, **close)
    torch.testing.assert_close(points(watched(motion)).detach(), expected, **close)


@pytest.mark.parametrize("kind", KINDS)
def test_twins_agree(kind: str) -> None:
    motion = poses(kind)
    points = SkinnedPoints(ACTOR, *choose(BATCH, FRAMES))
    pairs = zip(points.linearize(motion)[:2], points.linearize(watched(motion))[:2], strict=True)
    for compiled, plain in pairs:
        assert plain.requires_grad
        torch.testing.assert_close(compiled, plain.detach(), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_derivative_agrees_with_differences(kind: str) -> None:
    motion = poses(kind)
    points = SkinnedPoints(ACTOR, *choose(BATCH, FRAMES))
    _, jacobian, _ = points.linearize(motion)
    here, step = motion.coordinates(), 1e-6
    for column in range(motion.frame_dim):
        tangent = torch.zeros_like(here.frame)
        tangent[..., column] = step
        after, before = (points(motion.retract(Step(s * tangent, here.shared))) for s in (1, -1))
        numeric = (after - before) / (2 * step)
        error = (jacobian[..., column] - numeric).abs().max()
        assert error <= 1e-6 * max(1.0, float(numeric.abs().max())), column


def test_derivative_agrees_with_forward_mode() -> None:
    motion = poses("twisted")
    points = SkinnedPoints(ACTOR, *choose(BATCH, FRAMES))
    shared = motion.coordinates().shared

    def moved(tangent: Tensor) -> Tensor:
        step = tangent.expand(*motion.angles.shape[:-1], motion.frame_dim)
        result: Tensor = points(motion.retract(Step(step, shared)))
        return result

    exact = torch.func.jacfwd(moved)(torch.zeros(motion.frame_dim, dtype=F64))
    torch.testing.assert_close(points.linearize(motion)[1], exact, rtol=1e-9, atol=1e-9)


def test_derivative_along_directions() -> None:
    motion, random = poses("random"), torch.Generator().manual_seed(5)
    points = SkinnedPoints(ACTOR, *choose(BATCH, FRAMES))
    directions = torch.randn(BATCH, FRAMES, POINTS, 2, 3, generator=random, dtype=F64)
    expected = directions @ points.linearize(motion)[1]
    for state in (motion, watched(motion)):
        found = points.linearize(state, directions)[1].detach()
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-13)


def test_batch_equals_loop_and_shared_points_need_no_axes() -> None:
    motion = poses("random")
    corners, weights = choose(BATCH, FRAMES)
    whole = SkinnedPoints(ACTOR, corners, weights).linearize(motion)[:2]
    for b in range(BATCH):
        parts = (motion.translation[b], motion.rotation[b], motion.angles[b])
        one = SkinnedPoints(ACTOR, corners[b], weights[b]).linearize(Motion(*parts))[:2]
        for found, expected in zip(one, whole, strict=True):
            torch.testing.assert_close(found, expected[b], rtol=0, atol=0)
    for lead in ((), (FRAMES,)):
        few = choose(*lead)
        spread = [x.expand(BATCH, FRAMES, *x.shape[-2:]) for x in few]
        for state in (motion, watched(motion)):
            torch.testing.assert_close(
                SkinnedPoints(ACTOR, *few).linearize(state)[:2],
                SkinnedPoints(ACTOR, *spread).linearize(state)[:2],
            )


def test_moving_the_root_moves_every_point_rigidly() -> None:
    motion = poses("random")
    points, jacobian, _ = SkinnedPoints(ACTOR, *choose(BATCH, FRAMES)).linearize(motion)
    eye = torch.eye(3, dtype=F64).expand(*points.shape, 3)
    torch.testing.assert_close(jacobian[..., :3], eye, rtol=0, atol=1e-14)
    arms = (points - motion.translation.unsqueeze(-2)).unsqueeze(-2)
    turned = torch.linalg.cross(eye, arms.expand_as(eye)).mT
    torch.testing.assert_close(jacobian[..., 3:6], turned, rtol=0, atol=1e-13)


def test_padding_stays_at_the_origin() -> None:
    corners, weights = choose(FRAMES)
    weights[..., 5:, :] = 0
    motion = random_motion(ACTOR.skeleton, FRAMES)
    for state in (motion, watched(motion)):
        points, jacobian, _ = SkinnedPoints(ACTOR, corners, weights).linearize(state)
        assert not points[..., 5:, :].any()
        assert not jacobian[..., 5:, :, :].any()
        assert points[..., :5, :].any(-1).all()


def test_no_points_at_all() -> None:
    points = SkinnedPoints(ACTOR, torch.zeros(0, 2, dtype=torch.long), torch.zeros(0, 2))
    found, jacobian, _ = points.linearize(random_motion(ACTOR.skeleton, FRAMES))
    assert found.shape == (FRAMES, 0, 3)
    assert jacobian.shape == (FRAMES, 0, 3, 33)


def test_single_precision() -> None:
    motion, chosen = random_motion(ACTOR.skeleton, FRAMES), choose(FRAMES)
    exact = SkinnedPoints(ACTOR, *chosen).linearize(motion)[:2]
    single = SkinnedPoints(actor(), *chosen).float().linearize(motion.to(torch.zeros(1)))[:2]
    for found, expected in zip(single, exact, strict=True):
        assert found.dtype == torch.float32
        torch.testing.assert_close(found, expected.float(), rtol=0, atol=2e-6)


def test_rows_of_weights_hold_what_moves_a_vertex() -> None:
    weights = torch.tensor([[0.3, 0.4, 0.3], [1.0, 0.0, 0.0]])
    bones, row_weights, pivots = SkinWeights(weights, torch.tensor([[5, 2, 5], [0, 1, 2]])).rows()
    dense = torch.zeros(2, 6).scatter_add(1, bones, row_weights)
    expected = torch.tensor([[0, 0, 0.4, 0, 0, 0.6], [1.0, 0, 0, 0, 0, 0]])
    torch.testing.assert_close(dense, expected)
    assert pivots.tolist() == [5, 0]  # two small shares of one bone outweigh a larger one


def test_bad_points_are_refused() -> None:
    corners, weights = choose(FRAMES)
    with pytest.raises(InputError, match="one shape"):
        SkinnedPoints(ACTOR, corners, weights[..., :1])
    with pytest.raises(InputError, match="vertex indices"):
        SkinnedPoints(ACTOR, weights, weights)
    for wrong in (-1, COUNT):
        with pytest.raises(InputError, match=f"has {COUNT} vertices"):
            SkinnedPoints(ACTOR, corners.clone().fill_(wrong), weights)
    with pytest.raises(InputError, match="motion has frames"):
        SkinnedPoints(ACTOR, corners, weights)(random_motion(ACTOR.skeleton, FRAMES + 1))
    with pytest.raises(ValueError, match="resized"):
        SkinnedPoints(ACTOR, corners, weights)(random_motion(ACTOR.skeleton, FRAMES, bones=True))


# --- Points rigid with one joint ------------------------------------------------------------------


def on_limbs() -> tuple[Tensor, Tensor]:
    random = torch.Generator().manual_seed(2)
    joints = torch.arange(len(ACTOR.skeleton.rig.joints))
    return torch.randn(len(joints), 3, generator=random, dtype=F64), joints


@pytest.mark.parametrize("kind", KINDS)
def test_limb_points_move_with_their_joint(kind: str) -> None:
    motion, (places, joints) = poses(kind), on_limbs()
    points = LimbPoints(ACTOR, places, joints)
    rotation, translation = ACTOR.joint_transforms(motion)
    expected = (rotation @ places[..., None]).squeeze(-1) + translation
    close = {"rtol": 0, "atol": 1e-11}
    for state in (motion, watched(motion)):
        torch.testing.assert_close(points(state).detach(), expected, **close)
    _, jacobian, _ = points.linearize(motion)
    torch.testing.assert_close(points.linearize(watched(motion))[1].detach(), jacobian, **close)
    here, step = motion.coordinates(), 1e-6
    for column in range(motion.frame_dim):
        tangent = torch.zeros_like(here.frame)
        tangent[..., column] = step
        after, before = (points(motion.retract(Step(s * tangent, here.shared))) for s in (1, -1))
        numeric = (after - before) / (2 * step)
        assert (jacobian[..., column] - numeric).abs().max() < 1e-5


def test_limb_points_refuse_other_shapes_and_joints() -> None:
    places, joints = on_limbs()
    with pytest.raises(InputError, match=r"give \(N, 3\) and integers"):
        LimbPoints(ACTOR, places[:, :2], joints)
    with pytest.raises(InputError, match="the skeleton has"):
        LimbPoints(ACTOR, places, joints + 1)


def test_rest_of_a_posed_surface_is_what_was_posed() -> None:
    motion = poses("twisted")
    random = torch.Generator().manual_seed(4)
    rest = torch.randn(BATCH, FRAMES, COUNT, 3, generator=random, dtype=F64)
    found = ACTOR.at_rest(motion, ACTOR.surface(motion, rest))
    torch.testing.assert_close(found, rest, rtol=0, atol=1e-10)


def test_directions_of_other_frames_or_points_are_refused() -> None:
    """Compiled loops wrote beyond the end of arrays, and the process died."""
    motion = random_motion(ACTOR.skeleton, FRAMES, ())
    points = SkinnedPoints(ACTOR, *choose(FRAMES))
    for shape in ((1, POINTS, 1, 3), (FRAMES, POINTS - 1, 1, 3), (FRAMES, POINTS, 1, 2)):
        with pytest.raises(InputError, match="directions have shape"):
            points.linearize(motion, torch.zeros(shape, dtype=F64))
