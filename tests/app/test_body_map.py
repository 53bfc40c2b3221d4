"""The picture of how well a body is known."""

import numpy as np
import pytest
import torch

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import Measurements, measure
from perfcap.app.body_map import body_map, vertex_deviations
from perfcap.io.body_model import load_body_model
from perfcap.rigging import BodyFit

F64 = torch.float64


@pytest.fixture(scope="module")
def model() -> BodyModel:
    return load_body_model()


def fit(model: BodyModel, covariance: torch.Tensor) -> BodyFit:
    shape = torch.zeros(model.components, dtype=F64)
    motion = model.actor(torch.zeros(0)).skeleton.rest_motion(1)
    template = model.template(shape)
    known = Measurements(0.01, 0.02, 0.03, 0.04, 0.005)
    return BodyFit(shape, motion, template, measure(template), known, covariance)


def test_deviations_are_those_of_drawn_bodies(model: BodyModel) -> None:
    draw = torch.Generator().manual_seed(0)
    root = 0.1 * torch.randn(model.components, model.components, generator=draw, dtype=F64)
    found = vertex_deviations(model, fit(model, root @ root.mT))
    shapes = torch.randn(400, model.components, generator=draw, dtype=F64) @ root.mT
    bodies = model.surface.mean[::50] + torch.einsum(
        "bs,svk->bvk", shapes, model.surface.basis[:, ::50].double()
    )
    drawn = (bodies - model.surface.mean[::50]).square().sum(-1).mean(0).sqrt()
    np.testing.assert_allclose(found[::50], drawn.numpy(), rtol=0.15)


def test_three_bodies_and_their_bars_are_drawn(model: BodyModel) -> None:
    one = torch.zeros(model.components, dtype=F64)
    one[0] = 1.0
    picture = body_map(model, fit(model, one.diag()), 200, 800)
    assert picture.shape == (200, 800, 3)
    drawn = (picture != 255).any(-1)
    for column in range(3):  # the body, from the front, the side and the back
        part = drawn[:180, 100 * column : 100 * (column + 1)]
        assert 0.05 < part.mean() < 0.5 and not part[0].any()
    assert len(np.unique(picture[:180, :300].reshape(-1, 3), axis=0)) > 20  # colours differ
    bars = (picture[:, 300:] == (60, 110, 200)).all(-1).sum(1)
    long, short = (bars[int((row + 1) * 200 / 6)] for row in (3, 4))
    assert long > 4 * short > 0  # the hip's deviation is eight times the inseam's
