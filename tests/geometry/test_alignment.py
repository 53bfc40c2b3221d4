import pytest
import torch

from perfcap.errors import InputError
from perfcap.geometry.alignment import (
    Similarity,
    nearest_rotation,
    procrustes,
    rigid_align,
    similarity_align,
)
from perfcap.geometry.rotation import rotvec_to_matrix


@pytest.fixture(autouse=True)
def seed():
    torch.manual_seed(0)


def points(*shape):
    return torch.randn(*shape, 3, dtype=torch.float64)


def some_similarity(*batch):
    return Similarity(
        torch.rand(batch, dtype=torch.float64) + 0.5,
        rotvec_to_matrix(points(*batch)),
        points(*batch),
    )


def assert_rotation(matrix):
    identity = torch.eye(3, dtype=matrix.dtype).expand_as(matrix)
    torch.testing.assert_close(matrix @ matrix.mT, identity)
    torch.testing.assert_close(matrix.det(), torch.ones_like(matrix.det()))


@pytest.mark.parametrize("batch", [(), (5,), (2, 3)])
def test_recovers_a_similarity(batch):
    source, truth = points(*batch, 7), some_similarity(*batch)
    found = procrustes(source, truth.apply(source))
    for name in ("scale", "rotation", "translation"):
        torch.testing.assert_close(getattr(found, name), getattr(truth, name))


def test_recovers_a_rigid_motion_without_scale():
    source, truth = points(4, 9), some_similarity(4)
    target = truth.rotation @ source.mT
    target = target.mT + truth.translation[:, None]
    found = procrustes(source, target, scale=False)
    assert torch.equal(found.scale, torch.ones(4, dtype=torch.float64))
    torch.testing.assert_close(found.rotation, truth.rotation)
    torch.testing.assert_close(rigid_align(source, target), target)


def test_batch_equals_loop():
    source, target, weights = points(6, 8), points(6, 8), torch.rand(6, 8).double()
    batched = procrustes(source, target, weights).apply(source)
    for one, s, t, w in zip(batched, source, target, weights, strict=True):
        torch.testing.assert_close(one, procrustes(s, t, w).apply(s))


@pytest.mark.parametrize("scale", [True, False])
def test_no_neighbour_is_better(scale):
    source, target, weights = points(10), points(10), torch.rand(10).double()

    def cost(motion):
        return (weights * (motion.apply(source) - target).square().sum(-1)).sum()

    best = procrustes(source, target, weights, scale)
    for _ in range(30):
        turn = rotvec_to_matrix(0.01 * points())
        factor = 1 + 0.01 * torch.randn((), dtype=torch.float64) * scale
        near = Similarity(
            best.scale * factor, best.rotation @ turn, best.translation + 0.01 * points()
        )
        assert cost(near) > cost(best)


def test_mirror_image_gives_a_proper_rotation():
    source = points(20, 6)
    found = procrustes(source, source * source.new_tensor([-1, 1, 1]))
    assert_rotation(found.rotation)
    assert (found.scale >= 0).all()


def test_points_of_no_weight_do_not_count():
    source, truth = points(3, 6), some_similarity(3)
    target = truth.apply(source)
    target[:, 2] = torch.nan
    weights = torch.ones(3, 6, dtype=torch.float64)
    weights[:, 2] = 0
    source.requires_grad_()
    found = procrustes(source, target, weights)
    torch.testing.assert_close(found.rotation, truth.rotation)
    (gradient,) = torch.autograd.grad(found.translation.square().sum(), source)
    assert gradient.isfinite().all()
    assert (gradient[:, 2] == 0).all()


def test_one_bad_element_leaves_the_others_alone():
    source, target = points(3, 6), points(3, 6)
    expected = similarity_align(source, target)
    source[1, 0, 0] = torch.inf
    found = similarity_align(source, target)
    assert found[1].isnan().all()
    assert torch.equal(found[::2], expected[::2])


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize(
    "shape", ["one point", "equal points", "equal source", "equal target", "line", "plane", "tiny"]
)
def test_degenerate_points_are_finite(shape, dtype):
    source, target = points(5), points(5)
    if shape in ("one point", "equal points", "equal source"):
        source = source[:1].expand(5, 3)
    if shape in ("one point", "equal points", "equal target"):
        target = target[:1].expand(5, 3)
    if shape == "one point":
        source, target = source[:1], target[:1]
    if shape == "line":
        source, target = (torch.arange(5).double()[:, None] * points(2)[:, None]).unbind(0)
    if shape == "plane":
        source, target = (
            source * source.new_tensor([1, 1, 0]),
            target * source.new_tensor([0, 1, 1]),
        )
    if shape == "tiny":
        source = 1e-12 * source
    source = source.to(dtype).clone().requires_grad_()
    target = target.to(dtype).clone().requires_grad_()
    found = procrustes(source, target)
    values = torch.cat([found.scale.reshape(1), found.rotation.flatten(), found.translation])
    gradients = torch.autograd.grad(values.sum(), (source, target))
    assert all(tensor.isfinite().all() for tensor in (values, *gradients))
    if shape.startswith(("one", "equal")):
        assert torch.equal(found.rotation, torch.eye(3, dtype=dtype))
        assert found.scale == (0 if shape == "equal target" else 1)
    if shape in ("one point", "equal points"):
        torch.testing.assert_close(found.apply(source), target)
    if shape == "line":
        assert_rotation(found.rotation)
        torch.testing.assert_close(found.apply(source), target)


def test_no_weight_at_all_is_the_identity():
    found = procrustes(points(4), points(4), torch.zeros(4, dtype=torch.float64))
    assert torch.equal(found.rotation, torch.eye(3, dtype=torch.float64))
    assert found.scale == 1
    assert (found.translation == 0).all()


@pytest.mark.parametrize("scale", [True, False])
def test_derivatives(scale):
    source, target = points(2, 5).requires_grad_(), points(2, 5).requires_grad_()
    weights = (torch.rand(2, 5, dtype=torch.float64) + 0.1).requires_grad_()

    def aligned(s, t, w):
        return procrustes(s, t, w, scale).apply(s)

    assert torch.autograd.gradcheck(aligned, (source, target, weights))


def test_second_derivatives():
    matrix = points(3).requires_grad_()
    assert torch.autograd.gradgradcheck(nearest_rotation, matrix, atol=1e-6)


@pytest.mark.parametrize("values", [(1, 1, 1), (2, 2, 0.5), (2, 1, 1), (3, 2, 0), (3, 2, -1)])
def test_derivative_where_singular_values_repeat(values):
    diagonal = torch.tensor(values, dtype=torch.float64)
    left, right = rotvec_to_matrix(points(2))
    matrix = (left * diagonal @ right).requires_grad_()
    torch.testing.assert_close(nearest_rotation(matrix), left @ right)
    assert torch.autograd.gradcheck(nearest_rotation, matrix)


def test_vmap_and_jacobian():
    source, target = points(3, 5), points(3, 5)

    def turned(s, t):
        return procrustes(s, t).rotation

    torch.testing.assert_close(torch.func.vmap(turned)(source, target), turned(source, target))
    jacobian = torch.func.jacrev(turned)(source[0], target[0])
    step = 1e-6 * points(5)
    change = turned(source[0] + step, target[0]) - turned(source[0] - step, target[0])
    expected = torch.tensordot(jacobian, 2 * step, dims=2)
    torch.testing.assert_close(change, expected, rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize(
    ("source", "target", "weights"),
    [((4, 3), (5, 3), None), ((4, 2), (4, 2), None), ((3,), (3,), None), ((4, 3), (4, 3), (5,))],
)
def test_refuses_shapes(source, target, weights):
    with pytest.raises(InputError, match="shape"):
        procrustes(
            torch.zeros(source),
            torch.zeros(target),
            None if weights is None else torch.ones(weights),
        )


@pytest.mark.parametrize("values", [(0, 0, 0), (1, 0, 0), (1, 1, -1), (2, 1, -1), (1, 0, -1e-17)])
def test_derivative_is_finite_where_several_rotations_are_best(values):
    left, right = rotvec_to_matrix(points(2))
    matrix = (left * torch.tensor(values, dtype=torch.float64)) @ right
    matrix.requires_grad_()
    rotation = nearest_rotation(matrix)
    assert_rotation(rotation.detach())
    (gradient,) = torch.autograd.grad((rotation * points(3)).sum(), matrix)
    assert gradient.isfinite().all()
    assert gradient.abs().max() < 1e3  # the undetermined part is dropped, not amplified


@pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated:DeprecationWarning")
def test_forward_mode_equals_reverse():
    source, target = points(5), points(5)

    def aligned(source):
        return similarity_align(source, target)

    torch.testing.assert_close(
        torch.func.jacfwd(aligned)(source), torch.func.jacrev(aligned)(source)
    )


def test_float32_far_from_the_origin():
    source, truth = points(6, 16) + 5, some_similarity(6)
    target = truth.apply(source)
    found = procrustes(source.float(), target.float())
    torch.testing.assert_close(found.rotation.double(), truth.rotation, rtol=0, atol=3e-6)


@pytest.mark.usefixtures("both_twins")
def test_negative_weights_are_refused():
    with pytest.raises(InputError, match="weights are -1 at least, expected numbers from 0 on"):
        procrustes(points(5), points(5), -torch.ones(5))
