"""Contours of cameras that may stand elsewhere: zero at the truth, derivatives, what is refused."""

import math
from dataclasses import replace

import pytest
import torch
from checks import check_jacobian, check_shapes, check_value
from synthetic import actor, cameras, random_motion
from takes import handheld
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy import ContourAlignment, UncertainContours
from perfcap.energy.uncertain_views import CAMERAS
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.segment.correspondence import Correspondences
from perfcap.solve.kernels import GemanMcClure

F64 = torch.float64
ACTOR = actor()
VIEWS, FRAMES, POINTS = 2, 3, 10


def lenses() -> Camera:
    bend = torch.tensor([0.1, -0.05, 0.003, -0.002, 0.01], dtype=F64)
    return replace(cameras(VIEWS), distortion=bend.repeat(VIEWS, 1))


def step(size: float) -> Tensor:
    random = torch.Generator().manual_seed(5)
    return size * torch.randn(6 * VIEWS, generator=random, dtype=F64)


def seen(motion: Motion, camera: Camera, noise: float = 0.0) -> Correspondences:
    """Points anywhere on the surface, and lines through where a camera sees them."""
    random = torch.Generator().manual_seed(3)
    shape = (FRAMES, VIEWS, POINTS)
    vertices = torch.randint(len(ACTOR.vertices), (*shape, 2), generator=random)
    weights = torch.rand(*shape, 2, generator=random, dtype=F64)
    weights = weights / weights.sum(-1, keepdim=True)
    turn = 2 * math.pi * torch.rand(shape, generator=random, dtype=F64)
    confidence = torch.rand(shape, generator=random, dtype=F64)
    confidence = confidence.where(confidence > 0.2, confidence * 0)
    points = SkinnedPoints(ACTOR, vertices.flatten(1, 2), weights.flatten(1, 2))(motion)
    own = points.reshape(*shape, 3)
    target = noise * torch.randn(*shape, 2, generator=random, dtype=F64)
    for view in range(VIEWS):
        target[:, view] += camera.select([view]).project(own[:, view])[:, 0]
    normal = torch.stack((turn.cos(), turn.sin()), -1)
    return Correspondences(vertices, weights, target, normal, confidence)


def points_of(found: Correspondences) -> SkinnedPoints:
    return SkinnedPoints(ACTOR, found.vertices.flatten(-3, -2), found.weights.flatten(-3, -2))


def sharing(motion: Motion, values: Tensor) -> Motion:
    return replace(motion, shared={CAMERAS: values})


def test_zero_where_cameras_stand_as_they_do() -> None:
    motion, stated = random_motion(ACTOR.skeleton, FRAMES), lenses()
    found = seen(motion, stated.nudged(step(0.02)))
    energy = UncertainContours(points_of(found), stated, found)
    assert energy(sharing(motion, step(0.02))) < 1e-18
    assert energy(sharing(motion, step(0.0))) > 1.0
    assert energy(motion) == energy(sharing(motion, step(0.0)))


@pytest.mark.parametrize("size", [0.0, 0.05, 0.4])
def test_derivatives_are_those_of_differences(size: float) -> None:
    motion, stated = random_motion(ACTOR.skeleton, FRAMES), lenses()
    found = seen(motion, stated, 5.0)
    unit = torch.tensor([0.5, 2.0], dtype=F64)
    energy = UncertainContours(points_of(found), stated, found, 3.0, GemanMcClure(20.0), unit)
    state = sharing(motion, step(size))
    check_shapes(energy, state)
    check_value(energy, state)
    check_jacobian(energy, state)


def test_without_unknown_cameras_it_is_the_alignment_of_contours() -> None:
    motion, stated = random_motion(ACTOR.skeleton, FRAMES), lenses()
    found = seen(motion, stated, 5.0)
    energies = [
        kind(points_of(found), stated, found, 2.0) for kind in (ContourAlignment, UncertainContours)
    ]
    plain, own = (energy.linearize(motion) for energy in energies)
    assert torch.equal(plain.residual.value, own.residual.value)
    assert torch.equal(plain.frame, own.frame) and own.shared is None


def test_cameras_that_move_and_blocks_of_other_sizes_are_refused() -> None:
    motion, stated = random_motion(ACTOR.skeleton, FRAMES), cameras(VIEWS)
    found = seen(motion, stated)
    with pytest.raises(InputError, match="cameras move"):
        UncertainContours(points_of(found), handheld(stated, FRAMES), found)
    energy = UncertainContours(points_of(found), stated, found)
    with pytest.raises(InputError, match=r"shares cameras of shape \(5,\), expected \(12,\)"):
        energy(sharing(motion, step(0.0)[:5]))
