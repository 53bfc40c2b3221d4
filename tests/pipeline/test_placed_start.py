"""Poses to start from, of limbs far from where they hang."""

import pytest
import torch
from synthetic import actor as person
from synthetic import cameras as circle
from takes import F64, detect
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.objective import FrameProblem, neutral_angles
from perfcap.pipeline.placed_start import TRUNK, placed_start, trunk_start
from perfcap.pipeline.prepare import prepare

FRAMES = 40
ACTOR = person()


def anyhow() -> Motion:
    """Poses drawn from the inner four fifths of what joints can do, (F,), facing anywhere."""
    generator = torch.Generator().manual_seed(5)
    lower, upper = ACTOR.skeleton.lower, ACTOR.skeleton.upper
    middle = neutral_angles(ACTOR)
    lower, upper = torch.maximum(lower, middle - 2.5), torch.minimum(upper, middle + 2.5)
    share = 0.1 + 0.8 * torch.rand(FRAMES, len(middle), generator=generator, dtype=F64)
    rotation = torch.randn(FRAMES, 3, generator=generator, dtype=F64)
    place = torch.randn(FRAMES, 3, generator=generator, dtype=F64) / 3
    return Motion(place, rotation, lower + share * (upper - lower))


def worst_mm(found: Motion, truth: Motion) -> Tensor:
    """The largest error of a joint in each frame, (F,)."""
    return 1000 * (ACTOR.joints(found) - ACTOR.joints(truth)).norm(dim=-1).amax(-1)


@pytest.mark.parametrize("views", [2, 3])
def test_limbs_are_found_wherever_they_are(views: int) -> None:
    truth, cameras = anyhow(), circle(3, size=600).select(list(range(views)))
    seen = detect(ACTOR, cameras, truth, lifted=False)
    found, known = initialize(prepare(FrameProblem.of(ACTOR, cameras, seen)))
    off = worst_mm(found, truth)
    assert known.all()
    assert off.median() < 5
    assert (off > 50).double().mean() < 0.15


def test_several_estimates_count_by_their_confidence() -> None:
    """One of no confidence may say anything, and a joint that nobody places hangs."""
    truth = anyhow()
    right = ACTOR.joints(truth)
    points = torch.stack((right, torch.full_like(right, 5.0)), dim=1)
    certain = torch.ones(points.shape[:-1], dtype=F64)
    certain[:, 1] = 0
    found = placed_start(ACTOR, points, certain, PoseConfig())
    alone = placed_start(ACTOR, right[:, None], certain[:, :1], PoseConfig())
    assert torch.allclose(ACTOR.joints(found), ACTOR.joints(alone), atol=1e-9)
    assert worst_mm(found, truth).median() < 60


def test_the_trunk_alone_says_where_the_root_is() -> None:
    truth = anyhow()
    rest = Motion(truth.translation, truth.rotation, 0 * truth.angles + neutral_angles(ACTOR))
    places = ACTOR.joints(rest)
    weights = torch.zeros(places.shape[:-1], dtype=F64)
    weights[:, TRUNK] = 1
    found = trunk_start(ACTOR, places, weights)
    turn = rotvec_to_matrix(found.rotation).mT @ rotvec_to_matrix(rest.rotation)
    assert (found.translation - rest.translation).norm(dim=-1).max() < 0.05
    assert (turn.diagonal(dim1=-2, dim2=-1).sum(-1) > 2.95).all()
