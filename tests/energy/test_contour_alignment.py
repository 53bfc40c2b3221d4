"""Contours: zero at truth, derivatives, means, what counts nothing, and recovery of a pose."""

import math
from dataclasses import replace

import pytest
import torch
from checks import check_energy
from synthetic import actor, cameras, random_motion
from takes import handheld, sway
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.deformation import Deformation
from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy.contour_alignment import ContourAlignment
from perfcap.energy.joint_target import JointTarget
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix, skew
from perfcap.segment.correspondence import Correspondences
from perfcap.solve import Energy, LevenbergMarquardt, Objective, Step, solve
from perfcap.solve.energy import forward_mode
from perfcap.solve.kernels import GemanMcClure
from perfcap.solve.layout import Layout
from perfcap.solve.stationarity import gradient

F64 = torch.float64
ACTOR = actor()
FACES = torch.tensor(ACTOR.template.faces)
FRAMES, POINTS = 3, 12


def lenses(views: int) -> Camera:
    bend = torch.tensor([0.1, -0.05, 0.003, -0.002, 0.01], dtype=F64)
    return replace(cameras(views), distortion=bend.repeat(views, 1))


def pairs(motion: Motion, camera: Camera, noise: float = 0.0) -> Correspondences:
    """Points anywhere on the surface, lines through where they are seen; some count nothing."""
    random = torch.Generator().manual_seed(11)
    shape = (*motion.angles.shape[:-1], camera.views, POINTS)
    vertices = torch.randint(len(ACTOR.vertices), (*shape, 2), generator=random)
    weights = torch.rand(*shape, 2, generator=random, dtype=F64)
    turn = 2 * math.pi * torch.rand(shape, generator=random, dtype=F64)
    target = torch.randn(*shape, 2, generator=random, dtype=F64) * noise
    weights = weights / weights.sum(-1, keepdim=True)
    confidence = torch.rand(shape, generator=random, dtype=F64)
    confidence = confidence.where(confidence > 0.2, confidence * 0)
    points = SkinnedPoints(ACTOR, vertices.flatten(-3, -2), weights.flatten(-3, -2))(motion)
    own = points.reshape(*shape, 3)
    for view in range(camera.views):
        target[..., view, :, :] += camera.select([view]).project(own[..., view, :, :]).squeeze(-3)
    normal = torch.stack((turn.cos(), turn.sin()), -1)
    return Correspondences(vertices, weights, target, normal, confidence)


def points_of(found: Correspondences, person: Actor = ACTOR) -> SkinnedPoints:
    return SkinnedPoints(person, found.vertices.flatten(-3, -2), found.weights.flatten(-3, -2))


def align(camera: Camera, found: Correspondences, **options: object) -> ContourAlignment:
    return ContourAlignment(points_of(found), camera, found, **options)  # type: ignore[arg-type]


def near(motion: Motion, far: float = 0.1) -> Motion:
    random = torch.Generator().manual_seed(12)
    here = motion.coordinates()
    step = torch.randn(here.frame.shape, generator=random, dtype=F64)
    return motion.retract(Step(far * step, here.shared))


def element(motion: Motion, index: int) -> Motion:
    return Motion(motion.translation[index], motion.rotation[index], motion.angles[index])


def picked(found: Correspondences, index: int) -> Correspondences:
    names = ("vertices", "weights", "target", "normal", "confidence")
    return Correspondences(*(getattr(found, name)[index].detach() for name in names))


@pytest.mark.parametrize("views", [1, 3])
def test_zero_at_the_truth(views: int) -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(views)
    energy = align(camera, pairs(motion, camera))
    assert energy(motion) < 1e-18
    assert energy(near(motion)) > 1e-3


@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("moving", [False, True])
def test_closed_form_agrees_with_forward_mode(views: int, moving: bool) -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, (2,))
    camera = lenses(views)
    if moving:
        bend = camera.distortion
        assert bend is not None
        camera = handheld(replace(camera, distortion=None), FRAMES)
        camera = replace(camera, distortion=bend.expand(FRAMES, views, 5))
    unit = torch.linspace(0.5, 2, views, dtype=F64)
    energy = align(camera, pairs(motion, camera, 5.0), kernel=GemanMcClure(3.0), unit=unit)
    state = near(motion)
    closed, exact = energy.linearize(state), forward_mode(energy, state)
    assert torch.allclose(closed.residual.value, exact.residual.value, atol=1e-10)
    assert torch.allclose(closed.frame, exact.frame, atol=1e-8)


def test_everything_an_energy_promises() -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES, (2,)), lenses(2)
    found = pairs(motion, camera, 5.0)
    leaves = found.target.clone().requires_grad_(), found.normal.clone().requires_grad_()
    found, state = replace(found, target=leaves[0], normal=leaves[1]), near(motion)
    kernel, weight = GemanMcClure(20.0), 3.0

    def pick(index: int) -> tuple[Energy, Motion]:
        return align(camera, picked(found, index), kernel=kernel, weight=weight), element(
            state, index
        )

    energy = align(camera, found, kernel=kernel, weight=weight)
    check_energy(energy, state, pick=pick, inputs=leaves, atol=1e-4)


def test_frames_as_batch_elements() -> None:
    """How single frames are refined: every frame is a batch element with its own mean."""
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(2)
    found, state = pairs(motion, camera, 5.0), near(motion)
    single = Correspondences(*(getattr(found, n).unsqueeze(1) for n in found.__dataclass_fields__))
    parts = (state.translation, state.rotation, state.angles)
    energies = align(camera, single)(Motion(*(part.unsqueeze(1) for part in parts)))
    for frame in range(FRAMES):
        one = align(camera, found.frames(slice(frame, frame + 1)))
        assert torch.allclose(energies[frame], one(state[frame : frame + 1]))


def test_energy_is_a_mean() -> None:
    """Twice the points, or more padding, say nothing new."""
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(2)
    found, state = pairs(motion, camera, 5.0), near(motion)
    twice = Correspondences(
        *(
            torch.cat((getattr(found, n),) * 2, -2)
            for n in ("vertices", "weights", "target", "normal")
        ),
        torch.cat((found.confidence,) * 2, -1),
    )
    none = replace(found, confidence=torch.zeros_like(found.confidence))
    padded = Correspondences(
        *(
            torch.cat((getattr(found, n), getattr(none, n)), -1 if n == "confidence" else -2)
            for n in found.__dataclass_fields__
        )
    )
    energy, expected = align(camera, found, weight=2.0), None
    residual = energy.residual(state)
    counted = (found.confidence > 0).flatten(-2)
    expected = 2 * residual.squared_norm().sum() / (counted.sum() / (FRAMES * 2))
    for other in (found, twice, padded):
        assert torch.allclose(align(camera, other, weight=2.0)(state), expected)
    # a view that sees nothing takes nothing from those that do
    blind = replace(found, confidence=found.confidence * torch.tensor([[1.0], [0.0]]).double())
    one = align(
        camera.select([0]),
        Correspondences(*(getattr(found, n)[:, :1] for n in found.__dataclass_fields__)),
    )
    assert torch.allclose(align(camera, blind)(state), one(state))


def test_what_has_no_confidence_may_be_anything() -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(2)
    found, state = pairs(motion, camera, 5.0), near(motion)
    mad = torch.full_like(found.target, torch.nan)
    trusted = found.confidence.unsqueeze(-1) > 0
    odd = replace(
        found,
        target=found.target.where(trusted, mad),
        normal=found.normal.where(trusted, mad),
        vertices=found.vertices.where(trusted, torch.zeros_like(found.vertices)),
    )
    expected, closed = align(camera, found), align(camera, odd)
    assert torch.allclose(expected(state), closed(state))
    linear = closed.linearize(state)
    assert linear.frame.isfinite().all()
    assert linear.residual.value.isfinite().all()
    nobody = align(camera, replace(found, confidence=torch.zeros_like(found.confidence)))
    assert nobody(state) == 0


@pytest.mark.parametrize("depth", [-5.0, -12.0])
def test_behind_the_camera_nothing_counts(depth: float) -> None:
    """A person around and behind the camera: finite, and only what is in front pulls."""
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(1)
    found = pairs(motion, camera, 5.0)
    back = torch.tensor([0.0, 0.0, depth], dtype=F64) @ camera.rotation[0]
    state = replace(motion, translation=motion.translation + back)
    energy = align(camera, found)
    visible = camera.to_camera(points_of(found)(state)).squeeze(-3)[..., 2] > 0.05
    linear = energy.linearize(state)
    for part in (linear.frame, linear.residual.value, energy(state)):
        assert part.isfinite().all()
    assert not linear.residual.value[~visible].any()
    assert not linear.frame[~visible].any()
    assert visible.any() == (depth == -5.0)
    if depth < -10:
        assert energy(state) == 0


def test_views_must_match() -> None:
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(2)
    with pytest.raises(InputError, match="1 cameras"):
        align(camera.select([0]), pairs(motion, camera))


# --- points of a deformation ----------------------------------------------------------------------


class TwoNodePoints(torch.nn.Module):
    """Points (F, N, 3) that each follow the mean of two nodes' rigid motions about the origin."""

    def __init__(self, rest: Tensor, blocks: Tensor) -> None:
        super().__init__()
        self.rest, self.blocks = rest, blocks

    def forward(self, state: Deformation) -> Tensor:
        return self._moved(state).mean(-2)

    def linearize_blocks(
        self, state: Deformation, directions: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        turned = self._moved(state) - self._pick(state.translation)
        one = torch.eye(3, dtype=F64).expand(*turned.shape, 3)
        slope = 0.5 * torch.cat((-skew(turned), one), -1)
        return self(state), self.blocks, directions.unsqueeze(-3) @ slope

    def _pick(self, values: Tensor) -> Tensor:
        """Values (F, M, 3) at the blocks, (F, N, 2, 3)."""
        return values.gather(-2, self.blocks.flatten(-2)[..., None].expand(-1, -1, 3)).reshape(
            *self.blocks.shape, 3
        )

    def _moved(self, state: Deformation) -> Tensor:
        turn = rotvec_to_matrix(self._pick(state.rotation))
        turned = (turn @ self.rest[..., None, :, None]).squeeze(-1)
        return turned + self._pick(state.translation)


def test_blocks_of_a_deformation() -> None:
    random, nodes = torch.Generator().manual_seed(4), 5
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(2)
    found = pairs(motion, camera, 5.0)
    blocks = torch.rand(FRAMES, 2 * POINTS, nodes, generator=random).argsort(-1)[..., :2]
    points = TwoNodePoints(points_of(found)(motion), blocks)
    energy = ContourAlignment(points, camera, found, 2.0, GemanMcClure(9.0), 3.0)
    rotation, translation = 0.1 * torch.randn(2, FRAMES, nodes, 3, generator=random, dtype=F64)
    state = Deformation(rotation, translation)
    linear, exact = energy.linearize_blocks(state), energy.linearize(state)
    assert torch.allclose(linear.residual.value, exact.residual.value, atol=1e-10)
    assert linear.jacobian.shape == (FRAMES, 2 * POINTS, 2, 1, 6)
    dense = torch.zeros(FRAMES, 2 * POINTS, nodes, 6, dtype=F64)
    dense.scatter_(-2, blocks[..., None].expand(-1, -1, -1, 6), linear.jacobian.squeeze(-2))
    assert torch.allclose(dense.flatten(-2).unsqueeze(-2), exact.frame, atol=1e-9)
    check_energy(energy, state, atol=1e-4)


# --- recovery -------------------------------------------------------------------------------------


def outline(motion: Motion, camera: Camera) -> Correspondences:
    """Middles of the edges where the surface turns away from each view, exactly where they are."""
    surface, edges, sides = ACTOR.surface(motion), *_edges(FACES)
    local = camera.to_camera(surface)  # F C V 3
    a, b, c = (local[..., FACES[:, k], :] for k in range(3))
    facing = (torch.linalg.cross(b - a, c - a) * a).sum(-1) < 0
    turning = facing[..., sides[:, 0]] ^ facing[..., sides[:, 1]]  # F C E
    pixels = camera.project(surface)[..., edges, :]
    along = pixels[..., 1, :] - pixels[..., 0, :]
    normal = torch.stack((along[..., 1], -along[..., 0]), -1)
    normal = normal / normal.norm(dim=-1, keepdim=True).clamp(min=1e-9)
    vertices = edges.expand(*turning.shape, 2)
    weights = torch.full(vertices.shape, 0.5, dtype=F64)
    # the middle of an edge in space is not the middle of its image
    middle = camera.project(surface[..., edges, :].mean(-2))
    return Correspondences(vertices, weights, middle, normal, turning.to(F64))


def _edges(faces: Tensor) -> tuple[Tensor, Tensor]:
    """Edges (E, 2) that two faces share, and the two faces (E, 2)."""
    owner: dict[tuple[int, int], list[int]] = {}
    for index, face in enumerate(faces.tolist()):
        for i in range(3):
            low, high = sorted((face[i], face[(i + 1) % 3]))
            owner.setdefault((low, high), []).append(index)
    shared = {edge: both for edge, both in owner.items() if len(both) == 2}
    return torch.tensor(list(shared)), torch.tensor(list(shared.values()))


def joint_error(found: Motion, truth: Motion) -> Tensor:
    """Millimetres, (F,)."""
    return 1000 * (ACTOR.joints(found) - ACTOR.joints(truth)).norm(dim=-1).mean(-1)


@pytest.mark.parametrize("views", [1, 3])
def test_recovers_a_pose_from_outlines(views: int) -> None:
    truth, camera = sway(ACTOR, 4), cameras(3, size=1000).select(list(range(views)))
    found, start = outline(truth, camera), near(truth, 0.05)
    energies = Objective(
        contour=align(camera, found, unit=2.0),
        stay=JointTarget(
            ACTOR.landmarks, ACTOR.joints(start).unsqueeze(-3), weight=1e-7 / 16, unit=0.03
        ),
    )
    solution = solve(energies, start, LevenbergMarquardt(max_steps=30))
    before, after = joint_error(start, truth), joint_error(solution.state, truth)
    assert (before > 40).all()
    assert (after < (0.1 if views > 1 else 5.0)).all(), after
    assert energies.energies["contour"](solution.state) < 1e-4


def test_gradients_of_solutions_reach_what_contours_are_made_of() -> None:
    """The gradient that ``Implicit`` differentiates leads to them as the energy's own does."""
    motion, camera = random_motion(ACTOR.skeleton, FRAMES), lenses(2)
    found = pairs(motion, camera, noise=3.0)
    here = motion.coordinates()
    direction = torch.randn(here.frame.shape, generator=torch.Generator().manual_seed(5), dtype=F64)
    for name in ("target", "normal", "confidence", "translation", "weight"):
        parts = {n: getattr(found, n) for n in ("target", "normal", "confidence")}
        parts |= {"translation": camera.translation, "weight": torch.tensor(0.7, dtype=F64)}
        leaf = parts[name] = parts[name].clone().requires_grad_()
        energy = ContourAlignment(
            points_of(found),
            replace(camera, translation=parts.pop("translation")),
            weight=parts.pop("weight"),
            correspondences=replace(found, **parts),
            kernel=GemanMcClure(4.0),
        )
        layout = Layout.of(motion)
        closed = gradient(Objective(contour=energy), motion, layout)
        step = torch.zeros_like(here.frame, requires_grad=True)
        value = energy(motion.retract(Step(step, here.shared))).sum()
        (own,) = torch.autograd.grad(0.5 * value, step, create_graph=True)
        torch.testing.assert_close(closed.view_as(own), own)
        slopes = [
            torch.autograd.grad((direction * each.view_as(own)).sum(), leaf, retain_graph=True)[0]
            for each in (closed, own)
        ]
        torch.testing.assert_close(*slopes, msg=lambda text, name=name: f"{name}: {text}")
