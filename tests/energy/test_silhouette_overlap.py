"""Overlap of silhouettes: a loss for anything upstream, few rows for Gauss-Newton methods."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest
import torch
from checks import check_coupling, check_gradient, check_shapes
from synthetic import actor, bent_motion, cameras
from torch import Tensor

from perfcap.actor.deformation import Deformation
from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.actor.embedded_points import EmbeddedPoints
from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy.joint_target import JointTarget
from perfcap.energy.silhouette_overlap import SilhouetteOverlap
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.render.soft_silhouette import SoftSilhouette
from perfcap.solve import Adam, Implicit, LevenbergMarquardt, Objective, Step, solve
from perfcap.solve.kernels import GemanMcClure
from perfcap.solve.truncated_newton import TruncatedNewton

F64 = torch.float64
ACTOR = actor()
SIZE = 64
CAMERAS = cameras(2, SIZE, distance=3.0)
SILHOUETTE = SoftSilhouette(torch.tensor(ACTOR.template.faces), (SIZE, SIZE))
FAST = partial(SkinnedPoints, ACTOR)


def truth(frames: int = 2, batch: tuple[int, ...] = (), seed: int = 3) -> Motion:
    return bent_motion(ACTOR.skeleton, frames, batch, seed=seed)


def near(motion: Motion, size: float = 0.02) -> Motion:
    random = torch.Generator().manual_seed(4)
    frame = torch.randn(motion.coordinates().frame.shape, generator=random, dtype=F64)
    return motion.retract(Step(size * frame, motion.coordinates().shared))


def drawn(motion: Motion, camera: Camera = CAMERAS) -> Tensor:
    return SILHOUETTE.seen_by(camera, ACTOR.surface(motion))


def overlap(masks: Tensor, camera: Camera = CAMERAS, **settings: object) -> SilhouetteOverlap:
    chosen = {"points": FAST} | settings
    return SilhouetteOverlap(ACTOR.surface, SILHOUETTE, camera, masks, **chosen)


def pixel_jacobian(energy: SilhouetteOverlap, motion: Motion) -> tuple[Tensor, Tensor]:
    """Residuals of a single frame's pixels and their derivative, by forward mode."""
    none = motion.coordinates().shared

    def moved(step: Tensor) -> Tensor:
        return energy.residual(motion.retract(Step(step.expand(1, -1), none))).value[0]

    zero = torch.zeros(motion.frame_dim, dtype=F64)
    return moved(zero), torch.func.jacfwd(moved)(zero)


def test_zero_for_masks_that_fit() -> None:
    motion = truth()
    assert overlap(drawn(motion))(motion) == 0
    assert overlap(drawn(motion))(near(motion)) > 1e-3


def test_one_a_view_where_nothing_is_drawn() -> None:
    motion = truth()
    away = replace(motion, translation=motion.translation + 100)
    masks = (drawn(motion) > 0.5).to(F64)
    assert overlap(masks)(away) == pytest.approx(4, rel=1e-6)  # two frames in two views
    weight = torch.tensor([1.0, 0.25], dtype=F64)[:, None, None]
    assert overlap(masks, trust=weight)(away) == pytest.approx(2.5, rel=1e-6)


def test_shapes_and_derivatives() -> None:
    motion = truth()
    energy = overlap(drawn(near(motion)), weight=2.0, kernel=GemanMcClure(0.3))
    check_shapes(energy, motion)
    check_coupling(energy, motion)
    check_gradient(energy, motion, step=1e-7)


def test_hard_masks_and_trust_reach_the_value() -> None:
    motion, random = truth(), torch.Generator().manual_seed(1)
    masks = drawn(near(motion)) > 0.5
    trust = torch.rand(masks.shape, generator=random, dtype=F64)
    expected = (trust * (drawn(motion) - masks.to(F64)).square()).sum((-2, -1))
    expected = (expected / masks.sum((-2, -1))).sum()
    torch.testing.assert_close(overlap(masks, trust=trust)(motion), expected)


def test_an_empty_mask_counts_for_nothing() -> None:
    motion = truth()
    masks = drawn(near(motion))
    masks[0, 1] = 0
    energy = overlap(masks)
    assert (energy.residual(motion).value[0, 1] == 0).all()
    assert energy(motion).isfinite()
    assert energy.linearize(motion).frame.isfinite().all()


def test_gradient_reaches_masks_and_cameras() -> None:
    motion = truth()
    masks = drawn(near(motion)).requires_grad_()
    position = CAMERAS.translation.clone().requires_grad_()
    energy = overlap(masks, replace(CAMERAS, translation=position))
    for gradient in torch.autograd.grad(energy(motion), (masks, position)):
        assert gradient.isfinite().all()
        assert gradient.any()


def test_few_rows_stand_for_all_pixels() -> None:
    """Equal value and gradient; no less curvature, and more only where pixels see a crossing."""
    motion = truth()[:1]
    energy = overlap(drawn(near(motion)))
    value, jacobian = pixel_jacobian(energy, motion)  # C HW, C HW D
    linear = energy.linearize(motion)
    rows, few = linear.frame[0], linear.residual.value[0]
    assert rows.shape == (2, 34, 33)
    torch.testing.assert_close(few.square().sum(-1), value.square().sum(-1))
    pull = (jacobian * value[..., None]).sum(-2)
    torch.testing.assert_close((rows * few[..., None]).sum(-2), pull, rtol=1e-6, atol=1e-8)
    excess = rows.mT @ rows - jacobian.mT @ jacobian
    assert torch.linalg.eigvalsh(excess).min() > -1e-8
    # tubes without ends, 64 pixels: an image full of crossings
    assert excess.diagonal(dim1=-2, dim2=-1).sum() < 0.5 * jacobian.square().sum()


def test_without_chosen_points_the_surface_is_differentiated() -> None:
    motion = truth(batch=(2,))
    masks = drawn(near(motion))
    fast, slow = overlap(masks).linearize(motion), overlap(masks, points=None).linearize(motion)
    torch.testing.assert_close(fast.residual.value, slow.residual.value, rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(fast.frame, slow.frame, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("kernel", [None, GemanMcClure(0.5)])
def test_linearized_energy_is_the_energy(kernel: object) -> None:
    motion = truth(batch=(2,))
    energy = overlap(drawn(near(motion)), kernel=kernel, weight=3.0)
    torch.testing.assert_close(energy.cost(energy.linearize(motion).residual), energy(motion))


def test_batch_elements_stand_alone() -> None:
    motion = truth(batch=(2,))
    masks = drawn(near(motion))
    together = overlap(masks)(motion)
    for index in range(2):
        alone = Motion(*(x[index] for x in (motion.translation, motion.rotation, motion.angles)))
        torch.testing.assert_close(overlap(masks[index])(alone), together[index])


def test_levenberg_marquardt_recovers_a_motion() -> None:
    goal = truth()
    energy = overlap(drawn(goal))
    start = near(goal, 0.015)
    solution = solve(Objective(overlap=energy), start, LevenbergMarquardt(max_steps=15))
    assert solution.energy < 0.02 * energy(start)


def test_adam_lowers_the_energy() -> None:
    goal = truth()
    energy = overlap(drawn(goal))
    start = near(goal, 0.015)
    solution = solve(Objective(overlap=energy), start, Adam(max_steps=30, learning_rate=0.004))
    assert solution.energy < 0.4 * energy(start)


def graph_problem() -> tuple[SilhouetteOverlap, Deformation]:
    """Two frames in two views, deformed by a few nodes."""
    posed = ACTOR.surface(truth(seed=4))
    graph = DeformationGraph.build(ACTOR.vertices, SILHOUETTE.faces, nodes=40)
    state = graph.identity(posed)
    random = torch.Generator().manual_seed(6)
    step = 0.02 * torch.randn(state.coordinates().frame.shape, generator=random, dtype=F64)
    moved = state.retract(Step(step, state.coordinates().shared))
    points = partial(EmbeddedPoints, graph, posed)
    masks = SILHOUETTE.seen_by(CAMERAS, graph(posed, moved))
    settings = (lambda at: graph(posed, at)), SILHOUETTE, CAMERAS, masks
    return SilhouetteOverlap(*settings, weight=2.0, points=points), state


def test_rows_of_outline_edges_stand_for_all_pixels() -> None:
    energy, state = graph_problem()
    linear = energy.linearize_blocks(state)
    squared = energy.residual(state).squared_norm().sum(-1)
    torch.testing.assert_close(linear.residual.squared_norm().sum(-1), squared)
    frames, blocks = linear.blocks.shape[0], state.frame_dim // 6
    pull = torch.einsum("fgkdq,fgd->fgkq", linear.jacobian, linear.residual.value)
    index = linear.blocks.clamp_min(0).flatten(1)[..., None].expand(-1, -1, 6)
    pull = pull.where(linear.blocks[..., None] >= 0, 0.0).flatten(1, 2)
    gradient = torch.zeros(frames, blocks, 6, dtype=F64).scatter_add(1, index, pull)
    here = state.coordinates()
    zero = torch.zeros_like(here.frame).requires_grad_()
    (expected,) = torch.autograd.grad(energy(state.retract(Step(zero, here.shared))), zero)
    torch.testing.assert_close(4 * gradient.flatten(1), expected, rtol=1e-6, atol=1e-8)


def test_truncated_newton_fits_a_deformation() -> None:
    energy, state = graph_problem()
    method = TruncatedNewton(max_steps=10, damping=1e-3)
    solution = solve(Objective(overlap=energy), state, method)
    assert solution.energy.sum() < 0.05 * energy(state)


def test_surface_out_of_sight_and_full_masks() -> None:
    motion = truth()
    for masks in (torch.ones_like(drawn(motion)), drawn(motion)):
        for shift in (torch.tensor([100.0, 0, 0]), torch.tensor([0, 0, 3.0])):
            away = replace(motion, translation=motion.translation + shift)
            energy = overlap(masks)
            linear = energy.linearize(away)
            assert linear.frame.isfinite().all()
            torch.testing.assert_close(energy.cost(linear.residual), energy(away))


@pytest.mark.parametrize(
    ("masks", "settings", "words"),
    [
        (torch.zeros(2, 3, SIZE, SIZE), {}, "masks"),
        (torch.zeros(2, SIZE, SIZE), {}, "masks"),
        (torch.zeros(2, 2, SIZE, SIZE, dtype=torch.uint8), {}, "bool"),
        (torch.full((2, 2, SIZE, SIZE), 255.0), {}, "0 to 1"),
        (torch.full((2, 2, SIZE, SIZE), torch.nan), {}, "0 to 1"),
        (torch.zeros(2, 2, SIZE, SIZE), {"trust": torch.ones(3, 1, 1)}, "trust"),
        (torch.zeros(2, 2, SIZE, SIZE), {"trust": -torch.ones(1)}, "trust"),
        (torch.zeros(2, 2, SIZE, SIZE), {"camera": cameras(2, 50)}, "size"),
    ],
)
def test_bad_input_is_named(masks: Tensor, settings: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        overlap(masks, **settings)


def test_edges_have_no_robust_kernel() -> None:
    energy = overlap(drawn(truth()), kernel=GemanMcClure(1.0))
    with pytest.raises(InputError, match="Quadratic"):
        energy.linearize_blocks(truth())


def half_gradient(energy: SilhouetteOverlap, motion: Motion) -> Tensor:
    """Half the gradient of the energy in the motion's tangent, by automatic differentiation."""
    here = motion.coordinates()
    step = torch.zeros_like(here.frame, requires_grad=True)
    value = energy(motion.retract(Step(step, here.shared))).sum()
    return 0.5 * torch.autograd.grad(value, step)[0]


@pytest.mark.parametrize("kernel", [None, GemanMcClure(0.3)])
def test_gradients_of_solutions_reach_masks_and_trust(kernel: GemanMcClure | None) -> None:
    motion = truth()
    masks, random = drawn(near(motion)), torch.Generator().manual_seed(2)
    masks = 0.05 + 0.9 * masks
    trust = 0.2 + 0.8 * torch.rand(masks.shape, generator=random, dtype=F64)
    direction = torch.randn(motion.coordinates().frame.shape, generator=random, dtype=F64)
    for name in ("masks", "trust"):
        values = {"masks": masks, "trust": trust}
        leaf = values[name] = values[name].clone().requires_grad_()
        energy = overlap(values["masks"], trust=values["trust"], kernel=kernel, weight=2.0)
        gradient, _ = energy.gradient(motion)
        torch.testing.assert_close(gradient.detach(), half_gradient(energy, motion))
        (slope,) = torch.autograd.grad((direction * gradient).sum(), leaf)
        move = torch.randn(leaf.shape, generator=random, dtype=F64) * 0.05
        ends = []
        for sign in (1, -1):
            values[name] = leaf.detach() + sign * 1e-3 * move
            moved = overlap(values["masks"], trust=values["trust"], kernel=kernel, weight=2.0)
            ends.append((direction * half_gradient(moved, motion)).sum())
        numeric = float((ends[0] - ends[1]) / 2e-3)
        assert float((slope * move).sum()) == pytest.approx(numeric, rel=1e-5)


def test_gradients_of_solutions_reach_cameras() -> None:
    """To first order: where masks nearly fit, a camera that moves takes the person along."""
    motion = truth()[:1]
    masks = drawn(motion)
    position = CAMERAS.translation.clone().requires_grad_()
    moving = overlap(masks, replace(CAMERAS, translation=position))
    priors = JointTarget(ACTOR.landmarks, ACTOR.joints(motion).unsqueeze(-3), weight=1e-2 / 16)
    objective = Objective(masks=moving, hold=priors)
    found = solve(objective, motion, LevenbergMarquardt(5), None, Implicit())
    (gradient,) = torch.autograd.grad(found.state.translation[0, 1], position)
    # both cameras up by a metre: the world's y points up, the images' down
    assert float(gradient[:, 1].sum()) == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("points", [FAST, None])
def test_a_surface_of_no_numbers_is_not_out_of_sight(points: object) -> None:
    """Its energy was 1 a view, less than that of a surface beside its mask."""
    motion = truth()
    energy = overlap(drawn(motion), points=points)
    lost = replace(motion, translation=motion.translation.clone())
    lost.translation[0] = torch.nan
    assert energy.per_frame(lost).isnan().tolist() == [True, False]
    assert energy.linearize(lost).residual.value.isnan().flatten(1).any(1).tolist() == [True, False]
