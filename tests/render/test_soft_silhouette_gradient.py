"""Gradients of soft silhouettes: against central differences, and compiled against plain torch."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import synthetic
import torch
import trimesh
from test_soft_silhouette import SIZE, SQUARE, ball, joined, soup, square
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.actor import load_actor
from perfcap.io.gltf_read import load_template
from perfcap.render import _coverage, _outline_reference
from perfcap.render import _soft_silhouette_reference as reference
from perfcap.render.soft_silhouette import SoftSilhouette
from perfcap.solve import Step

F64 = torch.float64
SKIRT = Path(__file__).parents[2] / "../shared/data/rendered/dev_skirt/template.glb"
IMAGE = 160  # px


@pytest.fixture(scope="module")
def sam() -> Actor:
    return load_actor("sam")


def by_twin(
    silhouette: SoftSilhouette, pixels: Tensor, depth: Tensor, weight: Tensor
) -> tuple[Tensor, Tensor]:
    """Coverage and the gradient of its weighted sum in plain torch, for (B, V, 2)."""
    mesh = silhouette.borders(depth.shape[-1])
    points = mesh.points(pixels, depth)
    edges = mesh.faces, mesh.face_edges, mesh.edge_ends
    coverage, names, values = reference.draw(points, *edges, mesh.band, mesh.size)
    gradient = torch.zeros(points.shape[0] * points.shape[1], 2, dtype=F64)
    reference.pull_back(names, values, weight.reshape(-1), gradient)
    return coverage, mesh.spread(gradient.view_as(points))


def assert_twins_agree(
    silhouette: SoftSilhouette, pixels: Tensor, depth: Tensor, tolerance: float = 1e-9
) -> None:
    rng = torch.Generator().manual_seed(5)
    weight = torch.randn(len(pixels), *silhouette.size, generator=rng, dtype=F64)
    inputs = pixels.detach().requires_grad_()
    coverage = silhouette(inputs, depth)
    (gradient,) = torch.autograd.grad((coverage * weight).sum(), inputs)
    expected, expected_gradient = by_twin(silhouette, pixels, depth, weight)
    assert gradient.abs().sum() > 1
    torch.testing.assert_close(coverage, expected, rtol=0, atol=tolerance)
    torch.testing.assert_close(gradient, expected_gradient, rtol=tolerance, atol=tolerance)


def smooth_weight(size: tuple[int, int], seed: int = 0) -> Tensor:
    rng = torch.Generator().manual_seed(seed)
    coarse = torch.randn(1, 1, 10, 10, generator=rng, dtype=F64)
    return torch.nn.functional.interpolate(coarse, size=size, mode="bicubic")[0, 0]


def pixel_error(silhouette: SoftSilhouette, pixels: Tensor, depth: Tensor, step: float) -> float:
    """Relative error of the gradient in every vertex of one frame, (V, 2)."""
    weight = smooth_weight(silhouette.size)

    def value(at: Tensor) -> Tensor:
        return (silhouette(at, depth.expand(at.shape[:-1])) * weight).sum((-2, -1))

    inputs = pixels.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(value(inputs), inputs)
    moves = step * torch.eye(pixels.numel(), dtype=F64).view(-1, *pixels.shape)
    numeric = (value(pixels + moves) - value(pixels - moves)) / (2 * step)
    return float((gradient.flatten() - numeric).norm() / numeric.norm())


def pose_error(actor: Actor, seed: int, step: float = 1e-7) -> float:
    """Relative error of the gradient in the tangent of a random pose.

    Coverage has kinks (pixels that two outlines are equally near to): the step is so short, about
    1e-4 px, that differences seldom straddle one.
    """
    silhouette = soft(actor)
    weight = smooth_weight(silhouette.size, seed)
    cameras = synthetic.cameras(1, IMAGE, 2.6)
    motion = synthetic.random_motion(actor.skeleton, frames=1, seed=seed)
    none = torch.zeros(0, dtype=F64)

    def value(moves: Tensor) -> Tensor:
        poses = motion[torch.zeros(len(moves), dtype=torch.long)].retract(Step(moves, none))
        return (silhouette.seen_by(cameras, actor.surface(poses))[:, 0] * weight).sum((-2, -1))

    zero = torch.zeros(1, motion.frame_dim, dtype=F64, requires_grad=True)
    (gradient,) = torch.autograd.grad(value(zero).sum(), zero)
    moves = step * torch.eye(motion.frame_dim, dtype=F64)
    numeric = (value(moves) - value(-moves)) / (2 * step)
    return float((gradient[0] - numeric).norm() / numeric.norm())


def soft(actor: Actor) -> SoftSilhouette:
    place, _ = actor.template.weld()
    return SoftSilhouette(
        torch.tensor(actor.template.faces), (IMAGE, IMAGE), weld=torch.tensor(place)
    )


@pytest.mark.parametrize("band", [0.7, 2.0, 5.0])
@pytest.mark.parametrize("seed", range(3))
def test_twins_agree_on_open_meshes(seed: int, band: float) -> None:
    pixels, depth, faces = soup(seed)
    assert_twins_agree(SoftSilhouette(faces, SIZE, band), pixels[None], depth[None])


def test_twins_agree_on_an_integer_grid() -> None:
    """Horizontal edges, edges on pixel centres and edges on one another."""
    mesh = joined(square(5, 5, 20), square(5, 5, 20), square(25, 5, 10), square(10, 20, 20))
    assert_twins_agree(SoftSilhouette(mesh[2], SIZE), mesh[0][None], mesh[1][None])


def test_twins_agree_in_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "CANDIDATES", 50)
    monkeypatch.setattr(_outline_reference, "CANDIDATES", 20)
    pixels, depth, faces = soup(7, triangles=12)
    assert_twins_agree(SoftSilhouette(faces, SIZE), pixels[None], depth[None])


@pytest.mark.long
def test_twins_agree_on_a_person(sam: Actor) -> None:
    motion = synthetic.random_motion(sam.skeleton, frames=3, seed=1)
    cameras = synthetic.cameras(1, IMAGE, 2.6)
    local = cameras.to_camera(sam.surface(motion))[:, 0]
    pixels = cameras.project_camera(local[:, None])[:, 0]
    assert_twins_agree(soft(sam), pixels, local[..., 2])
    single = soft(sam)(pixels.float(), local[..., 2].float())
    plain = by_twin(soft(sam), pixels.float(), local[..., 2].float(), single)[0]
    torch.testing.assert_close(single.double(), plain, rtol=0, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_in_the_vertices_of_crossing_triangles(seed: int) -> None:
    """Where outlines cross, corners slide along both: up to four vertices move one pixel."""
    pixels, depth, faces = soup(seed, triangles=8)
    silhouette = SoftSilhouette(faces, SIZE)
    assert pixel_error(silhouette, pixels, depth.abs() + 0.1, step=1e-6) < 1e-5


def test_gradient_in_the_vertices_of_a_closed_mesh() -> None:
    """All of them, seen from a side without symmetry: there, vertices hide each other exactly."""
    mesh = trimesh.creation.icosphere(subdivisions=1)
    turn = rotvec_to_matrix(torch.tensor([0.3, -0.7, 0.45], dtype=F64))
    points = torch.tensor(mesh.vertices.copy()) @ turn
    pixels = 15.3 * points[:, :2] + torch.tensor([31.7, 23.6], dtype=F64)
    silhouette = SoftSilhouette(torch.tensor(mesh.faces.copy()), SIZE)
    assert pixel_error(silhouette, pixels, 4 + points[:, 2], step=1e-6) < 1e-5


@pytest.mark.long
@pytest.mark.parametrize("seed", [11, 12, 13])
def test_gradient_in_a_random_pose(sam: Actor, seed: int) -> None:
    assert pose_error(sam, seed) < 1e-3


@pytest.mark.slow
def test_gradient_in_many_random_poses(sam: Actor) -> None:
    assert max(pose_error(sam, seed) for seed in range(24)) < 1e-3


@pytest.mark.slow
@pytest.mark.skipif(not SKIRT.is_file(), reason="the skirt template is not beside the checkout")
def test_gradient_in_random_poses_with_a_skirt() -> None:
    actor = Actor(load_template(SKIRT))
    assert max(pose_error(actor, seed) for seed in range(10)) < 1e-3


def moved_ball() -> tuple[Callable[[Tensor], Tensor], Tensor]:
    """A ball's coverage, (1, H, W), as a function of where it is, (2,)."""
    pixels, depth, faces = ball()
    silhouette = SoftSilhouette(faces, SIZE)
    return lambda at: silhouette((pixels + at)[None], depth[None]), torch.zeros(2, dtype=F64)


def test_forward_and_reverse_mode_agree() -> None:
    function, zero = moved_ball()
    weight = smooth_weight(SIZE)
    forward = torch.func.jacfwd(function)(zero)  # 1 H W 2
    columns = torch.func.jacrev(lambda at: (function(at) * weight).sum(-1))(zero)  # 1 H 2
    torch.testing.assert_close((forward * weight[..., None]).sum(-2), columns)
    total = torch.func.grad(lambda at: (function(at) * weight).sum())(zero)
    torch.testing.assert_close(columns.sum((0, 1)), total)
    tangent = torch.tensor([0.3, -0.8], dtype=F64)
    _, change = torch.func.jvp(function, (zero,), (tangent,))
    torch.testing.assert_close(change, forward @ tangent)


def test_there_is_no_second_derivative() -> None:
    function, zero = moved_ball()
    at = zero.requires_grad_()
    (gradient,) = torch.autograd.grad(function(at).square().sum(), at, create_graph=True)
    with pytest.raises(RuntimeError, match="no second derivative"):
        torch.autograd.grad(gradient.sum(), at)
    with pytest.raises(RuntimeError, match="no second derivative"):
        torch.func.hessian(lambda at: function(at).square().sum())(zero.detach())


def test_a_batch_instead_of_vmap() -> None:
    function, zero = moved_ball()
    with pytest.raises(RuntimeError, match="batch"):
        torch.func.vmap(function)(zero.expand(3, 2))


def test_welding_is_differentiated_in_both_modes() -> None:
    whole, depth = square(10.3, 9.6, 20)
    split, weld = torch.tensor([[0, 1, 2], [3, 5, 4]]), torch.tensor([0, 1, 2, 0, 3, 2])
    silhouette = SoftSilhouette(split, SIZE, weld=weld)
    rng = torch.Generator().manual_seed(1)
    tangent = torch.randn(6, 2, generator=rng, dtype=F64)
    pixels = whole[weld]
    value, change = torch.func.jvp(lambda at: silhouette(at, depth[weld]), (pixels,), (tangent,))
    inputs = pixels.clone().requires_grad_()
    weight = smooth_weight(SIZE)
    (gradient,) = torch.autograd.grad((silhouette(inputs, depth[weld]) * weight).sum(), inputs)
    torch.testing.assert_close((change * weight).sum(), (gradient * tangent).sum())
    torch.testing.assert_close(value, SoftSilhouette(SQUARE, SIZE)(whole, depth))


def test_derivative_as_records() -> None:
    whole, depth = square(10.3, 9.6, 20)
    split, weld = torch.tensor([[0, 1, 2], [3, 5, 4]]), torch.tensor([0, 1, 2, 0, 3, 2])
    silhouette = SoftSilhouette(split, SIZE, weld=weld)
    pixels = torch.stack([whole, whole + 3.4])[:, weld]
    coverage, derivative = silhouette.linearize(pixels, depth[weld].expand(2, -1))
    torch.testing.assert_close(coverage, silhouette(pixels, depth[weld].expand(2, -1)))
    weight = torch.stack([smooth_weight(SIZE, 1), smooth_weight(SIZE, 2)])
    pull = weight.flatten()[derivative.pixel, None] * derivative.gradient
    share = derivative.share[:, None]
    gradient = torch.zeros(2, 6, 2, dtype=F64)
    image = derivative.pixel // (SIZE[0] * SIZE[1])
    for end, part in enumerate((1 - share, share)):
        vertex = derivative.vertices[:, end]
        gradient.index_put_((image, vertex), part * pull, accumulate=True)
    assert not gradient[:, [3, 5]].any()  # records name the first copy
    inputs = pixels.requires_grad_()
    drawn = silhouette(inputs, depth[weld].expand(2, -1))
    (expected,) = torch.autograd.grad((drawn * weight).sum(), inputs)
    welded = torch.zeros(2, 4, 2, dtype=F64)
    both = (welded.index_add(1, weld, each) for each in (gradient, expected))
    torch.testing.assert_close(*both)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_a_gpu_draws_the_same(sam: Actor) -> None:
    motion = synthetic.random_motion(sam.skeleton, frames=2, seed=1)
    cameras = synthetic.cameras(1, IMAGE, 2.6)
    local = cameras.to_camera(sam.surface(motion))[:, 0]
    pixels = cameras.project_camera(local[:, None])[:, 0].requires_grad_()
    weight = smooth_weight((IMAGE, IMAGE))
    results = []
    for device in ("cpu", "cuda"):
        silhouette = soft(sam).to(device)
        coverage = silhouette(pixels.to(device), local[..., 2].to(device))
        (gradient,) = torch.autograd.grad((coverage * weight.to(device)).sum(), pixels)
        results.append((coverage.cpu(), gradient))
    torch.testing.assert_close(results[0], results[1], rtol=1e-6, atol=1e-6)


def test_push_forward_agrees_with_pull_back() -> None:
    pixels, depth, faces = soup(3)
    mesh = SoftSilhouette(faces, SIZE).borders(len(pixels))
    _, records = _coverage.cover(mesh, pixels[None], depth[None])
    rng = torch.Generator().manual_seed(2)
    tangent = torch.randn(pixels.shape, generator=rng, dtype=F64)
    weight = torch.randn(SIZE, generator=rng, dtype=F64)
    change = _coverage.push_forward(mesh, records, tangent[None])
    gradient = _coverage.pull_back(mesh, records, weight[None])
    pixel = weight.view(-1)[records.names[:, 0]]
    torch.testing.assert_close((pixel * change).sum(), (gradient[0] * tangent).sum())
