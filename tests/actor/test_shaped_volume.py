"""Gaussians of a body of unknown shape: derivatives, and that they follow the surface."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from synthetic import random_motion

from perfcap.actor.actor import Actor
from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.shape_space import ShapeSpace
from perfcap.actor.shaped_volume import ShapedGaussians
from perfcap.actor.volume import Volume
from perfcap.actor.volume_fit import Silhouettes, VolumeFit, fit_volume, place_gaussians
from perfcap.io.body_model import load_body_model
from perfcap.solve import Step

F64 = torch.float64


def some(basis: int = 3, grown: bool = False) -> tuple[BodyModel, Actor, Volume]:
    """Some components of the shipped body, or one that is larger by a tenth."""
    whole = load_body_model()
    pairs = [(space.mean, space.basis[:basis]) for space in (whole.surface, whole.bones)]
    if grown:
        pairs = [(mean, 0.1 * mean[None]) for mean, _ in pairs]
    model = BodyModel(*(ShapeSpace(mean, axes) for mean, axes in pairs), whole.rig)
    actor = model.actor(torch.zeros(0)).to(torch.zeros((), dtype=F64))
    return model, actor, place_gaussians(actor, 60, np.random.default_rng(0))


def with_shape(actor: Actor, shape: torch.Tensor, frames: int = 2) -> Motion:
    return replace(random_motion(actor.skeleton, frames), shared={BODY: shape})


def test_the_mean_body_has_the_volume_it_was_given() -> None:
    model, actor, volume = some()
    body = ShapedGaussians.of(model, actor, volume)
    found = body.volume(torch.zeros(3, dtype=F64))
    for name in ("centres", "deviations", "densities"):
        torch.testing.assert_close(getattr(found, name), getattr(volume, name))
    still = replace(actor.skeleton.rest_motion(1), shared={BODY: torch.zeros(3, dtype=F64)})
    points = body(still)[0]
    torch.testing.assert_close(points[:, :3], volume.centres, atol=2e-3, rtol=0)
    torch.testing.assert_close(points[:, 3].exp(), volume.deviations)


def test_derivatives_in_pose_and_shape() -> None:
    model, actor, volume = some()
    body = ShapedGaussians.of(model, actor, volume)
    motion = with_shape(actor, torch.tensor([0.5, -1.0, 0.3], dtype=F64))
    points, frame, shared = body.linearize(motion)
    torch.testing.assert_close(points, body(motion))
    assert shared is not None and points.shape[-1] == 4
    here, draw = motion.coordinates(), torch.Generator().manual_seed(1)
    step = Step(
        torch.randn(here.frame.shape, generator=draw, dtype=F64),
        torch.randn(here.shared.shape, generator=draw, dtype=F64),
    )
    ahead, behind = (
        body(motion.retract(Step(s * 1e-6 * step.frame, s * 1e-6 * step.shared))) for s in (1, -1)
    )
    change = (frame @ step.frame[:, None, :, None]).squeeze(-1) + shared @ step.shared
    torch.testing.assert_close(change, (ahead - behind) / 2e-6, rtol=1e-6, atol=1e-6)


def test_a_larger_body_has_a_larger_volume() -> None:
    model, actor, volume = some(grown=True)
    one = torch.ones(1, dtype=F64)
    found = ShapedGaussians.of(model, actor, volume).volume(one)
    torch.testing.assert_close(found.centres, 1.1 * volume.centres, rtol=0, atol=2e-4)
    torch.testing.assert_close(
        (found.deviations / volume.deviations).log(),
        torch.full((60,), 0.1).double(),
        rtol=0,
        atol=1e-4,
    )
    torch.testing.assert_close(
        found.deviations * found.densities, volume.deviations * volume.densities
    )


@pytest.mark.slow
def test_other_bodies_look_like_their_volumes() -> None:
    """Nearly as much as volumes that were fitted to them, and more than if widths stayed."""
    model, actor, _ = some(20)
    body = ShapedGaussians.of(model, actor, fit_volume(actor))
    draw = torch.Generator().manual_seed(2)
    for _ in range(3):
        shape = torch.randn(20, generator=draw, dtype=F64).clamp(-2, 2)
        person = model.actor(shape).to(shape)
        looks = Silhouettes(person, VolumeFit(), np.random.default_rng(1))
        carried = body.volume(shape)
        still = replace(carried, deviations=body.volume(0 * shape).deviations)
        overlap, own = np.mean(looks.overlap(carried)), np.mean(looks.overlap(fit_volume(person)))
        assert overlap > 0.92 and overlap > own - 0.015
        assert overlap > np.mean(looks.overlap(still))
