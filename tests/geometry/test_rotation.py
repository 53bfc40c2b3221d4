"""Rotation maps against scipy and at their bad points."""

import math

import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from perfcap.geometry.rotation import (
    aligned,
    compose_rotvec,
    matrix_to_quaternion,
    matrix_to_rotvec,
    quaternion_multiply,
    quaternion_to_matrix,
    quaternion_to_rotvec,
    rotvec_to_matrix,
    rotvec_to_quaternion,
    skew,
    turn_to_y,
)

ANGLES = (0.0, 1e-12, 1e-9, 1e-8, 1.5e-8, 1e-7, 1e-4, 0.5, 2.0, 3.1, math.pi - 1e-9, math.pi)


def directions(count: int = 5) -> Tensor:
    random = torch.Generator().manual_seed(1)
    vectors = torch.randn(count, 3, generator=random, dtype=torch.float64)
    axes = torch.eye(3, dtype=torch.float64)
    return torch.cat((torch.nn.functional.normalize(vectors, dim=-1), axes, -axes))


@pytest.mark.parametrize("angle", [*ANGLES, 4.0, 2 * math.pi, 11.0])
def test_matrix_and_quaternion_agree_with_scipy(angle: float) -> None:
    rotvec = angle * directions()
    expected = Rotation.from_rotvec(rotvec.numpy())
    matrix, quaternion = rotvec_to_matrix(rotvec), rotvec_to_quaternion(rotvec)
    assert torch.allclose(matrix, torch.tensor(expected.as_matrix()), atol=1e-14)
    same = (quaternion * torch.tensor(expected.as_quat(scalar_first=True))).sum(-1).abs()
    assert torch.allclose(same, torch.ones_like(same), atol=1e-14)
    assert torch.allclose(quaternion_to_matrix(quaternion), matrix, atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES[:-1])
def test_logarithm_undoes_exponential(angle: float) -> None:
    rotvec = angle * directions()
    assert torch.allclose(quaternion_to_rotvec(rotvec_to_quaternion(rotvec)), rotvec, atol=1e-14)
    # near half a turn a matrix holds the axis to the square root of rounding only
    assert torch.allclose(matrix_to_rotvec(rotvec_to_matrix(rotvec)), rotvec, atol=1e-7)


def test_half_a_turn_comes_back_with_either_sign() -> None:
    rotvec = math.pi * directions()
    for back in (
        quaternion_to_rotvec(rotvec_to_quaternion(rotvec)),
        matrix_to_rotvec(rotvec_to_matrix(rotvec)),
    ):
        assert torch.allclose(back.norm(dim=-1), rotvec.norm(dim=-1), atol=1e-7)
        assert torch.allclose(rotvec_to_matrix(back), rotvec_to_matrix(rotvec), atol=1e-7)


def test_a_pure_half_turn_quaternion_is_finite() -> None:
    half = torch.tensor([0.0, 0.0, 1.0, 0.0], dtype=torch.float64, requires_grad=True)
    rotvec = quaternion_to_rotvec(half)
    rotvec.sum().backward()
    assert torch.allclose(rotvec.detach(), torch.tensor([0.0, math.pi, 0.0], dtype=torch.float64))
    assert half.grad is not None
    assert torch.isfinite(half.grad).all()


def test_float32_stays_accurate_near_the_identity() -> None:
    for angle in (1e-6, 1e-4, 3e-4, 4e-4, 1e-3, 1e-2):
        exact = angle * directions()
        back = quaternion_to_rotvec(rotvec_to_quaternion(exact.float()))
        assert (back.double() - exact).norm(dim=-1).max() < 3e-7 * angle


@pytest.mark.long
@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-3, 1.0, math.pi - 1e-3, math.pi])
def test_derivatives_are_finite_and_right(angle: float) -> None:
    rotvec = (angle * directions(2)).requires_grad_()
    assert torch.autograd.gradcheck(rotvec_to_quaternion, rotvec, check_forward_ad=True)
    assert torch.autograd.gradcheck(rotvec_to_matrix, rotvec, check_forward_ad=True)
    if angle < math.pi:
        there_and_back = lambda v: quaternion_to_rotvec(rotvec_to_quaternion(v))  # noqa: E731
        assert torch.autograd.gradcheck(there_and_back, rotvec, check_forward_ad=True)


def test_derivative_of_the_exponential_at_zero_is_the_generator() -> None:
    zero = torch.zeros(3, dtype=torch.float64)
    jacobian = torch.func.jacfwd(rotvec_to_matrix)(zero)
    expected = skew(torch.eye(3, dtype=torch.float64)).permute(1, 2, 0)
    assert torch.allclose(jacobian, expected, atol=1e-15)


def test_composition_is_the_product_of_matrices() -> None:
    random = torch.Generator().manual_seed(2)
    left, right = 4 * torch.randn(2, 50, 3, generator=random, dtype=torch.float64)
    expected = rotvec_to_matrix(left) @ rotvec_to_matrix(right)
    product = quaternion_multiply(rotvec_to_quaternion(left), rotvec_to_quaternion(right))
    assert torch.allclose(quaternion_to_matrix(product), expected, atol=1e-13)
    assert torch.allclose(rotvec_to_matrix(compose_rotvec(left, right)), expected, atol=1e-13)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_compiled_composition_is_the_plain_one(dtype: torch.dtype) -> None:
    left = torch.cat([angle * directions() for angle in ANGLES[:-1]]).to(dtype)
    right = left.flip(0)
    compiled = compose_rotvec(left, right)
    plain = compose_rotvec(left.clone().requires_grad_(), right).detach()
    assert compiled.dtype == dtype
    # half a turn may come back with either sign
    difference = (compiled - plain).norm(dim=-1).minimum((compiled + plain).norm(dim=-1))
    assert difference.max() < 20 * torch.finfo(dtype).eps
    broadcast = compose_rotvec(left[:, None], right[None, :3])
    assert torch.allclose(broadcast[4, 1], compose_rotvec(left[4], right[1]))


def test_composition_differentiates_under_every_transform() -> None:
    random = torch.Generator().manual_seed(3)
    left, right = torch.randn(2, 4, 3, generator=random, dtype=torch.float64)
    assert torch.autograd.gradcheck(compose_rotvec, (left.requires_grad_(), right))
    left = left.detach()
    reverse = torch.func.jacrev(compose_rotvec)(left, right)
    assert torch.allclose(torch.func.jacfwd(compose_rotvec)(left, right), reverse)
    batched = torch.func.vmap(compose_rotvec)(left, right)
    assert torch.allclose(batched, compose_rotvec(left, right), atol=1e-14)


def test_matrix_to_quaternion_has_unit_length() -> None:
    quaternion = matrix_to_quaternion(rotvec_to_matrix(2 * directions()))
    assert torch.allclose(quaternion.norm(dim=-1), torch.ones(len(quaternion)).double())


def test_skew_is_the_cross_product() -> None:
    u, v = directions()[:4], directions()[4:8]
    assert torch.allclose((skew(u) @ v[..., None])[..., 0], torch.linalg.cross(u, v))


@pytest.mark.parametrize("down", [1.0, -1.0])
@pytest.mark.parametrize("tilt", [(0.1, 0.02), (-0.03, 0.1), (0.05, -0.08), (0.0, 0.0)])
def test_any_direction_becomes_up_and_headings_stay(down: float, tilt: tuple[float, float]) -> None:
    up = torch.nn.functional.normalize(torch.tensor([tilt[0], down, tilt[1]]).double(), dim=0)
    turn = turn_to_y(up)
    torch.testing.assert_close(turn @ up, torch.tensor([0.0, 1.0, 0.0]).double())
    torch.testing.assert_close(turn @ turn.mT, torch.eye(3).double())
    assert float(turn[0, 0]) > 0.98  # x stays nearly where it was


def test_a_world_upside_down_is_turned_over_about_x() -> None:
    turn = turn_to_y(torch.tensor([0.0, -1.0, 0.0]))
    assert torch.equal(turn, torch.diag(torch.tensor([1.0, -1.0, -1.0])))


def test_aligned_quaternions_are_smooth_through_full_turns() -> None:
    turns = torch.linspace(0, 3 * 2 * math.pi, 100, dtype=torch.float64)
    axis = torch.nn.functional.normalize(torch.tensor([0.2, 1.0, -0.1], dtype=torch.float64), dim=0)
    wrapped = matrix_to_rotvec(rotvec_to_matrix(turns[:, None] * axis))
    assert wrapped.diff(dim=0).norm(dim=-1).max() > 5  # the chart does jump
    quaternions = aligned(rotvec_to_quaternion(wrapped))
    step = turns[1] / 2
    assert torch.allclose(
        quaternions.diff(dim=0).norm(dim=-1), 2 * (step / 2).sin().expand(99), atol=1e-7
    )
    sign = 1 if quaternions[0, 0] > 0 else -1
    exact = torch.cat(((turns / 2).cos()[:, None], (turns / 2).sin()[:, None] * axis), -1)
    assert torch.allclose(quaternions, sign * exact, atol=1e-7)


def test_alignment_keeps_the_first_and_works_per_batch() -> None:
    random = torch.Generator().manual_seed(4)
    quaternions = torch.randn(3, 6, 4, generator=random, dtype=torch.float64)
    together = aligned(quaternions)
    assert torch.equal(together[:, 0], quaternions[:, 0])
    assert ((together[:, 1:] * together[:, :-1]).sum(-1) >= 0).all()
    assert torch.equal(together, torch.stack([aligned(one) for one in quaternions]))
    assert torch.equal(aligned(quaternions[:, :1]), quaternions[:, :1])
