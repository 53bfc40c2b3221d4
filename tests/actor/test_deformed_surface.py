"""A surface of two unknowns: its points and their derivative in both."""

from __future__ import annotations

from contextlib import nullcontext
from functools import cache

import pytest
import torch
from synthetic import actor, random_motion
from torch import Tensor

from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.actor.deformed_surface import DeformedSurface
from perfcap.geometry import torch_only
from perfcap.solve import Compound, Step

F64 = torch.float64
ACTOR = actor()
CORNERS = torch.arange(0, 200, 9)[:, None]


@cache
def graph() -> DeformationGraph:
    return DeformationGraph.build(ACTOR.vertices, torch.tensor(ACTOR.template.faces), 12)


@cache
def surface() -> DeformedSurface:
    return DeformedSurface(ACTOR, graph())


def state(batch: tuple[int, ...] = (), size: float = 0.1) -> Compound:
    still = surface().start(random_motion(ACTOR.skeleton, 2, batch, seed=3))
    random = torch.Generator().manual_seed(5)
    frame = torch.randn(still.coordinates().frame.shape, generator=random, dtype=F64)
    return still.retract(Step(size * frame, still.coordinates().shared))


def test_without_deformation_it_is_the_actor() -> None:
    motion = random_motion(ACTOR.skeleton, 2, (), seed=3)
    assert torch.equal(surface()(surface().start(motion)), ACTOR.surface(motion))


def test_a_deformation_rides_on_the_limbs() -> None:
    """What moves at rest is carried by the pose: lengths at a bone do not depend on the motion."""
    here = state()
    rest = graph()(ACTOR.vertices.expand(2, -1, 3), here.parts["deformation"])
    joints, weights, _ = ACTOR.skin.rows()
    sole = (weights[:, 0] == 1) & (joints[:, 0] == joints[0, 0])
    assert sole.sum() > 3
    posed = surface()(here)
    torch.testing.assert_close(*(torch.cdist(x[:, sole], x[:, sole]) for x in (posed, rest)))


@pytest.mark.parametrize("batch", [(), (2,)])
@pytest.mark.parametrize("compiled", [False, True])
def test_points_are_those_of_the_surface(batch: tuple[int, ...], compiled: bool) -> None:
    here, points = state(batch), surface().points(CORNERS, torch.ones_like(CORNERS))
    with nullcontext() if compiled else torch_only():
        torch.testing.assert_close(points(here), surface()(here)[..., CORNERS[:, 0], :])
        torch.testing.assert_close(points.linearize(here)[0], points(here))


@pytest.mark.parametrize("batch", [(), (2,)])
def test_closed_form_is_the_derivative(batch: tuple[int, ...]) -> None:
    here, points = state(batch), surface().points(CORNERS, torch.ones_like(CORNERS))
    shape, none = here.coordinates().frame.shape, here.coordinates().shared

    def moved(tangent: Tensor) -> Tensor:
        return points(here.retract(Step(tangent.expand(shape), none)))

    expected = torch.func.jacfwd(moved)(torch.zeros(here.frame_dim, dtype=F64))
    found = points.linearize(here)[1]
    assert found[..., here.columns("deformation")].any()
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12)


def test_a_point_is_a_vertex() -> None:
    pairs = torch.tensor([[0, 1]])
    with pytest.raises(ValueError, match="single vertices"):
        surface().points(pairs, torch.ones_like(pairs))
