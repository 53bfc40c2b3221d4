import pytest
import torch

from perfcap.geometry.rotation import (
    matrix_to_rotvec,
    nearest_turn,
    rotation_mean,
    rotvec_to_matrix,
    unwrapped,
)

PI = torch.pi


@pytest.fixture(autouse=True)
def seed():
    torch.manual_seed(0)


def relative(a, b):
    return matrix_to_rotvec(rotvec_to_matrix(a).mT @ rotvec_to_matrix(b))


def weights_of(*shape):
    return torch.rand(*shape, dtype=torch.float64).softmax(-1)


def test_two_rotations_are_slerped():
    a, b = torch.randn(2, 40, 3, dtype=torch.float64)
    share = torch.rand(40, dtype=torch.float64)
    mean = rotation_mean(torch.stack((a, b), -2), torch.stack((1 - share, share), -1))
    expected = rotvec_to_matrix(a) @ rotvec_to_matrix(share[:, None] * relative(a, b))
    torch.testing.assert_close(rotvec_to_matrix(mean), expected)


def test_mean_of_many_is_stationary():
    rotvecs = torch.randn(30, 1, 3, dtype=torch.float64)
    rotvecs = rotvecs + 0.5 * torch.randn(30, 4, 3, dtype=torch.float64)
    weights = weights_of(30, 4)
    mean = rotation_mean(rotvecs, weights)
    pull = (weights[..., None] * relative(mean[:, None], rotvecs)).sum(-2)
    assert pull.abs().max() < 1e-7


def test_mean_ignores_full_turns_and_order():
    rotvecs = torch.randn(20, 3, 3, dtype=torch.float64) * 0.6
    weights = weights_of(20, 3)
    mean = rotvec_to_matrix(rotation_mean(rotvecs, weights))
    turned = rotvecs.clone()
    turned[:, 1] += 2 * PI * torch.nn.functional.normalize(turned[:, 1], dim=-1)
    torch.testing.assert_close(rotvec_to_matrix(rotation_mean(turned, weights)), mean)
    swapped = rotation_mean(rotvecs.flip(-2), weights.flip(-1))
    torch.testing.assert_close(rotvec_to_matrix(swapped), mean, rtol=0, atol=1e-8)


def test_mean_turns_with_the_rotations():
    rotvecs, weights = torch.randn(8, 3, 3, dtype=torch.float64), weights_of(8, 3)
    turn = rotvec_to_matrix(torch.randn(3, dtype=torch.float64))
    moved = matrix_to_rotvec(turn @ rotvec_to_matrix(rotvecs))
    torch.testing.assert_close(
        rotvec_to_matrix(rotation_mean(moved, weights)),
        turn @ rotvec_to_matrix(rotation_mean(rotvecs, weights)),
        rtol=0,
        atol=1e-6,
    )


@pytest.mark.parametrize("vector", [[0, 0, 0], [PI, 0, 0], [0, 2 * PI, 0], [0, 0, -9.0]])
def test_equal_vectors_come_back_to_the_bit(vector):
    rotvecs = torch.tensor([vector] * 3, dtype=torch.float64)
    assert torch.equal(rotation_mean(rotvecs, weights_of(3)), rotvecs[0])


@pytest.mark.parametrize("sign", [1, -1])
def test_half_turns_of_opposite_sign_are_one_rotation(sign):
    rotvecs = torch.tensor([[PI, 0, 0], [sign * PI, 0, 0]], dtype=torch.float64)
    mean = rotation_mean(rotvecs, weights_of(2))
    torch.testing.assert_close(mean.abs(), rotvecs[0])


@pytest.mark.parametrize("angle", [0.0, 1e-9, PI - 1e-9, PI, 2 * PI])
def test_mean_and_gradient_are_finite_at_bad_angles(angle):
    rotvecs = torch.zeros(2, 3, dtype=torch.float64)
    rotvecs[1, 0] = angle
    rotvecs.requires_grad_()
    mean = rotation_mean(rotvecs, torch.tensor([0.5, 0.5], dtype=torch.float64))
    (gradient,) = torch.autograd.grad(mean.sum(), rotvecs)
    assert mean.isfinite().all()
    assert gradient.isfinite().all()


def test_gradcheck_with_equal_and_different_vectors():
    rotvecs = torch.randn(3, 3, 3, dtype=torch.float64)
    rotvecs[0] = rotvecs[0, :1]
    rotvecs.requires_grad_()
    weights = weights_of(3, 3).requires_grad_()
    assert torch.autograd.gradcheck(rotation_mean, (rotvecs[:, :2], weights[:, :2]), atol=1e-6)
    assert torch.autograd.gradcheck(rotation_mean, (rotvecs[1:], weights[1:]))


def test_nearest_turn():
    reference = torch.tensor([[0, 0, 7.0], [9.3, 0, 0], [0, 0.2, 0], [0, 0, 12.6]]).double()
    short = matrix_to_rotvec(rotvec_to_matrix(reference + 0.01))
    torch.testing.assert_close(nearest_turn(short, reference), reference + 0.01, rtol=0, atol=0.02)
    still = torch.zeros(4, 3, dtype=torch.float64)
    turns = nearest_turn(still, reference).norm(dim=-1) / (2 * PI)
    torch.testing.assert_close(turns, turns.new_tensor([1.0, 1.0, 0.0, 2.0]))
    assert torch.equal(nearest_turn(still, still), still)


def test_unwrapped_follows_many_turns():
    angle = torch.linspace(0.5, 30, 200, dtype=torch.float64)[:, None]
    curve = angle * torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    wrapped = matrix_to_rotvec(rotvec_to_matrix(torch.stack((curve, -curve))))
    found = unwrapped(wrapped)
    torch.testing.assert_close(found, torch.stack((curve, -curve)))
    torch.testing.assert_close(rotvec_to_matrix(found), rotvec_to_matrix(wrapped))
    assert torch.equal(unwrapped(found), found)
