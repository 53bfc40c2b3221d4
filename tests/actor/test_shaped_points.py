"""Pose and shape together: against the actor of a shape, and against differences."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic
import torch

from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.io.body_model import load_body_model
from perfcap.solve import Step


@pytest.fixture(scope="module")
def model() -> BodyModel:
    return load_body_model()


def state(model: BodyModel, frames: int = 2, batch: tuple[int, ...] = ()) -> Motion:
    actor = model.actor(torch.zeros(model.components))
    motion = synthetic.random_motion(actor.skeleton, frames, batch)
    random = torch.Generator().manual_seed(2)
    shape = torch.randn(*batch, model.components, generator=random, dtype=torch.float64)
    return Motion(motion.translation, motion.rotation, motion.angles, {BODY: shape})


def points(model: BodyModel) -> ShapedPoints:
    actor = model.actor(torch.zeros(model.components))
    chosen = np.arange(0, len(model.surface.mean), 301)
    return ShapedPoints.of_surface(model, actor, chosen)


def test_the_mean_is_the_actor(model: BodyModel) -> None:
    actor = model.actor(torch.zeros(model.components))
    moved = state(model)
    plain = Motion(moved.translation, moved.rotation, moved.angles)
    still = Motion(moved.translation, moved.rotation, moved.angles, {BODY: 0 * moved.shared[BODY]})
    marks = ShapedPoints.of_landmarks(model, actor)(still)
    assert torch.allclose(marks[..., :16, :], actor.joints(plain), atol=1e-6)
    assert torch.allclose(marks[..., 16:, :], actor.skeleton(plain).position, atol=1e-6)


def test_rest_pose_of_a_shape_is_its_surface(model: BodyModel) -> None:
    body = points(model)
    rest = body.skeleton.rest_motion()
    shape = state(model).shared[BODY]
    chosen = np.arange(0, len(model.surface.mean), 301)
    found = body(Motion(rest.translation, rest.rotation, rest.angles, {BODY: shape}))[0]
    expected = model.vertices(shape)[chosen]
    offset = found[0] - expected[0]  # the root stands where the motion says
    assert torch.allclose(found, expected + offset, atol=1e-7)


@pytest.mark.parametrize("batch", [(), (2,)])
def test_derivatives_against_differences(model: BodyModel, batch: tuple[int, ...]) -> None:
    body, here = points(model), state(model, batch=batch)
    value, frame, shared = body.linearize(here)
    assert torch.allclose(value, body(here), atol=1e-12)
    size = 1e-6
    for column in range(here.frame_dim):
        tangent = torch.zeros(*here.angles.shape[:-1], here.frame_dim, dtype=torch.float64)
        tangent[..., column] = size
        none = torch.zeros_like(here.shared[BODY])
        up, down = (body(here.retract(Step(s * tangent, none))) for s in (1, -1))
        assert torch.allclose(frame[..., column], (up - down) / (2 * size), atol=1e-8)
    for column in (0, 3, model.components - 1):
        tangent = torch.zeros_like(here.shared[BODY])
        tangent[..., column] = 1.0
        none = torch.zeros(*here.angles.shape[:-1], here.frame_dim, dtype=torch.float64)
        up = body(here.retract(Step(none, tangent)))
        assert torch.allclose(shared[..., column], up - value, atol=1e-10)  # linear in shape


def test_needs_a_shape(model: BodyModel) -> None:
    moved = state(model)
    with pytest.raises(ValueError, match=r"needs a shared block .body."):
        points(model)(Motion(moved.translation, moved.rotation, moved.angles))
