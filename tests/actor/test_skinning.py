import copy

import pytest
import torch

from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import dual_quaternion_blend, linear_blend
from perfcap.errors import InputError
from perfcap.geometry.dual_quaternion import DualQuaternion
from perfcap.geometry.rotation import quaternion_to_matrix, rotvec_to_matrix

BLENDS = [linear_blend, dual_quaternion_blend]
VERTICES, BONES, SLOTS = 40, 6, 4


@pytest.fixture(autouse=True)
def seed():
    torch.manual_seed(0)


def transforms(*batch, spread=1.0):
    rotation = rotvec_to_matrix(spread * torch.randn(*batch, BONES, 3, dtype=torch.float64))
    return rotation, torch.randn(*batch, BONES, 3, dtype=torch.float64)


def skin():
    index = torch.rand(VERTICES, BONES).argsort(1)[:, :SLOTS]
    weights = torch.rand(VERTICES, SLOTS, dtype=torch.float64)
    return weights / weights.sum(1, keepdim=True), index


def dense(weights, index):
    return torch.zeros(VERTICES, BONES, dtype=torch.float64).scatter_add(1, index, weights)


def mesh(*batch):
    return torch.randn(*batch, VERTICES, 3, dtype=torch.float64)


def plain(blend, vertices, weights, index, rotation, translation):
    """The definition, one pose, gathered and summed."""
    if blend is linear_blend:
        moved = (rotation[index] @ vertices[:, None, :, None]).squeeze(-1) + translation[index]
        return (weights[..., None] * moved).sum(1)
    motion = DualQuaternion.from_rigid(rotation[index], translation[index])
    return motion.blend(weights).apply(vertices[:, None]).squeeze(1)


@pytest.mark.parametrize("blend", BLENDS)
def test_equals_the_definition(blend):
    vertices, (weights, index) = mesh(), skin()
    rotation, translation = transforms(3)
    found = blend(vertices, weights, rotation, translation, index)
    for one, r, t in zip(found, rotation, translation, strict=True):
        torch.testing.assert_close(one, plain(blend, vertices, weights, index, r, t))


@pytest.mark.parametrize("blend", BLENDS)
def test_sparse_dense_and_prepared_weights_agree(blend):
    vertices, (weights, index), motion = mesh(), skin(), transforms(2)
    expected = blend(vertices, dense(weights, index), *motion)
    torch.testing.assert_close(blend(vertices, weights, *motion, weight_index=index), expected)
    prepared = SkinWeights(weights, index)
    torch.testing.assert_close(blend(vertices, prepared, *motion), expected)
    torch.testing.assert_close(blend(vertices, copy.deepcopy(prepared), *motion), expected)


@pytest.mark.parametrize("blend", BLENDS)
def test_moving_all_bones_moves_the_mesh_rigidly(blend):
    vertices, (weights, index) = mesh(), skin()
    rotation, translation = rotvec_to_matrix(mesh()[0]), mesh()[0]
    found = blend(
        vertices, weights, rotation.expand(BONES, 3, 3), translation.expand(BONES, 3), index
    )
    torch.testing.assert_close(found, vertices @ rotation.mT + translation)


@pytest.mark.parametrize("blend", BLENDS)
def test_turning_the_world_turns_the_result(blend):
    vertices, (weights, index), (rotation, translation) = mesh(), skin(), transforms()
    turn, shift = rotvec_to_matrix(mesh()[0]), mesh()[0]
    moved = (turn @ rotation, (turn @ translation[..., None]).squeeze(-1) + shift)
    expected = blend(vertices, weights, rotation, translation, index) @ turn.mT + shift
    torch.testing.assert_close(blend(vertices, weights, *moved, index), expected)


@pytest.mark.parametrize("blend", BLENDS)
def test_vertices_of_one_bone_are_rigid(blend):
    vertices, (rotation, translation) = mesh(), transforms()
    owner = torch.arange(VERTICES) % BONES
    weights = torch.nn.functional.one_hot(owner, BONES).double()
    expected = (rotation[owner] @ vertices[..., None]).squeeze(-1) + translation[owner]
    torch.testing.assert_close(blend(vertices, weights, rotation, translation), expected)


def test_a_quarter_twist_keeps_its_radius_only_with_dual_quaternions():
    ring = torch.linspace(0, 6, VERTICES, dtype=torch.float64)
    vertices = torch.stack((torch.zeros_like(ring), ring.cos(), ring.sin()), -1)
    twist = torch.tensor([[0, 0, 0], [torch.pi / 2, 0, 0]], dtype=torch.float64)
    weights = torch.full((VERTICES, 2), 0.5, dtype=torch.float64)
    motion = rotvec_to_matrix(twist), torch.zeros(2, 3, dtype=torch.float64)
    kept = dual_quaternion_blend(vertices, weights, *motion)
    torch.testing.assert_close(kept.norm(dim=-1), torch.ones_like(ring))
    torch.testing.assert_close(kept, vertices @ rotvec_to_matrix(twist[1] / 2).mT)
    shrunk = linear_blend(vertices, weights, *motion).norm(dim=-1)
    torch.testing.assert_close(shrunk, torch.full_like(ring, 0.5**0.5))


@pytest.mark.parametrize("turns", [0, 1])
def test_does_not_jump_when_a_bone_passes_half_and_full_turns(turns):
    # the quaternion of a matrix changes sign on the way; the surface must not
    vertices, (weights, index) = mesh(), skin()
    angles = torch.linspace(3.0, 3.3, 301, dtype=torch.float64) + turns * torch.pi
    rotvec = angles[:, None, None] * torch.tensor([[0.6, 0.0, 0.8]] * BONES, dtype=torch.float64)
    rotvec = rotvec + 0.3 * torch.randn(BONES, 3, dtype=torch.float64)
    motion = rotvec_to_matrix(rotvec), torch.zeros(301, BONES, 3, dtype=torch.float64)
    moved = dual_quaternion_blend(vertices, weights, *motion, weight_index=index)
    assert moved.diff(dim=0).norm(dim=-1).max() < 0.01


@pytest.mark.parametrize("blend", BLENDS)
@pytest.mark.parametrize("batch", [(), (1,), (19,), (2, 3), (0,)])
def test_batch_equals_loop(blend, batch):
    vertices, weights = mesh(), SkinWeights(*skin())
    rotation, translation = transforms(*batch)
    found = blend(vertices, weights, rotation, translation)
    assert found.shape == (*batch, VERTICES, 3)
    meshes = vertices.expand(*batch, VERTICES, 3)
    torch.testing.assert_close(blend(meshes, weights, rotation, translation), found)
    poses = zip(
        found.reshape(-1, VERTICES, 3),
        rotation.reshape(-1, BONES, 3, 3),
        translation.reshape(-1, BONES, 3),
        strict=True,
    )
    for one, r, t in poses:
        torch.testing.assert_close(one, blend(vertices, weights, r, t))


def test_bone_named_twice_counts_once():
    vertices, (rotation, translation) = mesh(), transforms()
    index = torch.tensor([[1, 2, 1, 0]]).expand(VERTICES, 4)
    weights = torch.tensor([[0.3, 0.4, 0.3, 0.0]], dtype=torch.float64).expand(VERTICES, 4)
    torch.testing.assert_close(
        dual_quaternion_blend(vertices, weights, rotation, translation, index),
        dual_quaternion_blend(vertices, dense(weights, index), rotation, translation),
    )
    _, shares, _ = SkinWeights(weights, index).rows()  # a card's products want each bone once
    assert shares.shape == (VERTICES, 2)
    assert torch.allclose(shares.sort(-1).values, weights.new_tensor([0.4, 0.6]))


@pytest.mark.parametrize("blend", BLENDS)
def test_derivatives(blend):
    weights, index = skin()
    weights = SkinWeights(weights[:5], index[:5])
    real = torch.nn.functional.normalize(torch.randn(2, BONES, 4, dtype=torch.float64), dim=-1)

    def moved(vertices, real, translation):
        rotation = quaternion_to_matrix(torch.nn.functional.normalize(real, dim=-1))
        return blend(vertices, weights, rotation, translation)

    inputs = (mesh()[:5], real, torch.randn(2, BONES, 3, dtype=torch.float64))
    assert torch.autograd.gradcheck(moved, [x.requires_grad_() for x in inputs])


@pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated:DeprecationWarning")
@pytest.mark.parametrize("blend", BLENDS)
def test_forward_mode_vmap_and_second_derivatives(blend):
    vertices, weights = mesh(), SkinWeights(*skin())
    rotvec = 0.5 * torch.randn(BONES, 3, dtype=torch.float64)
    translation = torch.randn(BONES, 3, dtype=torch.float64)

    def moved(rotvec):
        return blend(vertices, weights, rotvec_to_matrix(rotvec), translation)

    reverse = torch.func.jacrev(moved)(rotvec)
    torch.testing.assert_close(torch.func.jacfwd(moved)(rotvec), reverse)
    several = torch.stack((rotvec, 2 * rotvec))
    torch.testing.assert_close(
        torch.func.vmap(moved)(several), torch.stack([moved(r) for r in several])
    )

    def energy(rotvec):
        return moved(rotvec).square().sum() + moved(rotvec)[0, 0] ** 3

    hessian = torch.func.hessian(energy)(rotvec).reshape(3 * BONES, 3 * BONES)
    direction = torch.randn(BONES, 3, dtype=torch.float64)
    gradient = torch.func.grad(energy)
    change = gradient(rotvec + 1e-5 * direction) - gradient(rotvec - 1e-5 * direction)
    torch.testing.assert_close(
        hessian @ direction.flatten(), change.flatten() / 2e-5, rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("angle", [0.0, torch.pi])
def test_gradients_are_finite_at_rest_and_at_half_turns(angle):
    weights, index = skin()
    rotvec = torch.zeros(BONES, 3, dtype=torch.float64)
    rotvec[::2, 0] = angle
    rotation = rotvec_to_matrix(rotvec).requires_grad_()
    translation = torch.zeros(BONES, 3, dtype=torch.float64)
    found = dual_quaternion_blend(mesh(), weights, rotation, translation, index)
    (gradient,) = torch.autograd.grad(found.sum(), rotation)
    assert found.isfinite().all()
    assert gradient.isfinite().all()


def test_float32_is_close_and_other_types_are_refused():
    vertices, prepared, motion = mesh(), SkinWeights(*skin()), transforms(2)
    expected = dual_quaternion_blend(vertices, prepared, *motion)
    with pytest.raises(InputError, match="float64"):
        dual_quaternion_blend(vertices.float(), prepared, *(x.float() for x in motion))
    single = copy.deepcopy(prepared).float()
    found = dual_quaternion_blend(vertices.float(), single, *(x.float() for x in motion))
    torch.testing.assert_close(found.double(), expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("row", "message"),
    [([-0.1, 1.1], "negative"), ([0, 0], "all zero"), ([1, torch.nan], "finite")],
)
def test_refuses_weights(row, message):
    weights = torch.tensor([[0.5, 0.5], row])
    with pytest.raises(InputError, match=f"vertex 1 .*{message}"):
        SkinWeights(weights)


def test_refuses_indices_and_shapes():
    weights, index = skin()
    with pytest.raises(InputError, match="weight_index"):
        SkinWeights(weights, index - 9)
    with pytest.raises(InputError, match="shape"):
        SkinWeights(weights, index[:, :2])
    rotation, translation = transforms()
    with pytest.raises(InputError, match="bone 5"):
        linear_blend(mesh(), weights, rotation[:5], translation[:5], index)
    with pytest.raises(InputError, match="vertices"):
        linear_blend(mesh()[:3], weights, rotation, translation, index)
    with pytest.raises(InputError, match="rotation"):
        linear_blend(mesh(), weights, rotation, translation[:2], index)
