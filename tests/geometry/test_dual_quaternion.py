import pytest
import torch

from perfcap.geometry.dual_quaternion import DualQuaternion
from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix


@pytest.fixture(autouse=True)
def seed():
    torch.manual_seed(0)


def rigid(*batch):
    rotation = rotvec_to_matrix(torch.randn(*batch, 3, dtype=torch.float64))
    return rotation, torch.randn(*batch, 3, dtype=torch.float64)


def flipped(motion, which):
    sign = torch.where(which, -1.0, 1.0)[..., None]
    return DualQuaternion(sign * motion.real, sign * motion.dual)


def assert_same(a, b):
    for x, y in zip(a.to_rigid(), b.to_rigid(), strict=True):
        torch.testing.assert_close(x, y)


@pytest.mark.parametrize("batch", [(), (5,), (2, 3)])
def test_round_trip_and_application(batch):
    rotation, translation = rigid(*batch)
    motion = DualQuaternion.from_rigid(rotation, translation)
    found = motion.to_rigid()
    torch.testing.assert_close(found[0], rotation)
    torch.testing.assert_close(found[1], translation)
    points = torch.randn(*batch, 6, 3, dtype=torch.float64)
    expected = points @ rotation.mT + translation.unsqueeze(-2)
    torch.testing.assert_close(motion.apply(points), expected)


def test_is_a_unit_dual_quaternion():
    motion = DualQuaternion.from_rigid(*rigid(7))
    torch.testing.assert_close(motion.real.norm(dim=-1), torch.ones(7, dtype=torch.float64))
    assert (motion.real * motion.dual).sum(-1).abs().max() < 1e-15


def test_products_compose_and_inverse_undoes():
    a, b = DualQuaternion.from_rigid(*rigid(4)), DualQuaternion.from_rigid(*rigid(4))
    points = torch.randn(4, 5, 3, dtype=torch.float64)
    torch.testing.assert_close(a.multiply(b).apply(points), a.apply(b.apply(points)))
    torch.testing.assert_close(a.inverse().apply(a.apply(points)), points)


def test_blend_of_one_and_of_equal_motions_is_itself():
    motion = DualQuaternion.from_rigid(*rigid(6, 1))
    itself = DualQuaternion(motion.real[:, 0], motion.dual[:, 0])
    assert_same(motion.blend(torch.full((6, 1), 0.3, dtype=torch.float64)), itself)
    same = DualQuaternion(motion.real.expand(6, 4, 4), motion.dual.expand(6, 4, 4))
    weights = torch.rand(6, 4, dtype=torch.float64)
    assert_same(flipped(same, torch.rand(6, 4) < 0.5).blend(weights), itself)


def test_blend_does_not_see_signs():
    motion, weights = DualQuaternion.from_rigid(*rigid(50, 4)), torch.rand(50, 4).double()
    assert_same(flipped(motion, torch.rand(50, 4) < 0.5).blend(weights), motion.blend(weights))


def test_blend_turns_with_the_motions():
    motions, weights = DualQuaternion.from_rigid(*rigid(20, 3)), torch.rand(20, 3).double()
    turn = DualQuaternion.from_rigid(*rigid(1, 1))
    left = turn.multiply(motions).blend(weights)
    assert_same(left, DualQuaternion(turn.real[0], turn.dual[0]).multiply(motions.blend(weights)))
    right = motions.multiply(turn).blend(weights)
    assert_same(right, motions.blend(weights).multiply(DualQuaternion(turn.real[0], turn.dual[0])))


def test_half_way_between_two_turns_about_one_axis():
    axis = torch.tensor([0.0, 0.6, 0.8], dtype=torch.float64)
    rotation = rotvec_to_matrix(torch.stack((0.1 * axis, 1.5 * axis)))
    motion = DualQuaternion.from_rigid(rotation, torch.zeros(2, 3, dtype=torch.float64))
    blended = motion.blend(torch.tensor([0.5, 0.5], dtype=torch.float64))
    torch.testing.assert_close(matrix_to_rotvec(blended.to_rigid()[0]), 0.8 * axis)


def test_blend_of_opposite_half_turns_is_finite():
    half = torch.tensor([[torch.pi, 0, 0], [0, torch.pi, 0]], dtype=torch.float64)
    motion = DualQuaternion.from_rigid(rotvec_to_matrix(half), torch.ones(2, 3).double())
    for part in motion.blend(torch.tensor([0.5, 0.5], dtype=torch.float64)).to_rigid():
        assert part.isfinite().all()


@pytest.mark.parametrize("angle", [0.0, torch.pi])
def test_gradients_are_finite_at_zero_and_half_a_turn(angle):
    rotvec = torch.tensor([angle, 0, 0], dtype=torch.float64)
    rotation = rotvec_to_matrix(rotvec).requires_grad_()
    motion = DualQuaternion.from_rigid(rotation, torch.ones(3, dtype=torch.float64))
    (gradient,) = torch.autograd.grad(motion.translation.sum() + motion.real.sum(), rotation)
    assert gradient.isfinite().all()


def test_derivatives():
    real = torch.nn.functional.normalize(torch.randn(2, 3, 4, dtype=torch.float64), dim=-1)
    dual = torch.randn(2, 3, 4, dtype=torch.float64)
    weights = torch.rand(2, 3, dtype=torch.float64)
    inputs = tuple(x.requires_grad_() for x in (real, dual, weights))
    assert torch.autograd.gradcheck(
        lambda r, d, w: DualQuaternion(r, d).blend(w).to_rigid(), inputs
    )
