"""Right views of people, of whom no change may seem to be the better."""

from dataclasses import replace

import pytest
import torch
from crowds import make_crowd

from perfcap.detect.association.sightings import AssociationConfig
from perfcap.detect.association.view_doubts import view_doubts


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("views", [2, 4])
@pytest.mark.parametrize("noise", [6.0, 10.0])
def test_right_views_of_unsure_joints(seed: int, views: int, noise: float) -> None:
    """Joints fit better the smaller people are, since errors in metres are smaller with them."""
    crowd = make_crowd(seed, views=views, noise=noise)
    assert view_doubts(crowd.cameras, crowd.candidates, AssociationConfig()) == ()


@pytest.mark.long
def test_a_few_frames_say_nothing() -> None:
    crowd = make_crowd(1)
    exchanged = crowd.candidates.select([3, 1, 2, 0])
    config = AssociationConfig()
    assert view_doubts(crowd.cameras, exchanged.frames(slice(0, 5)), config) == ()
    assert "look exchanged" in view_doubts(crowd.cameras, exchanged.frames(slice(0, 12)), config)[0]


@pytest.mark.long
@pytest.mark.parametrize(("scale", "size"), [(0.5, "half"), (2.0, "twice")])
@pytest.mark.parametrize("view", [0, 2])
def test_one_view_of_other_pixels_is_named(view: int, scale: float, size: str) -> None:
    """Nothing was said of it, or that all are too large."""
    crowd = make_crowd(1, views=4)
    factors = torch.ones(4, 1, 1).double()
    factors[view] = scale
    resized = replace(crowd.candidates, joints2d=factors * crowd.candidates.joints2d)
    (line,) = view_doubts(crowd.cameras, resized, AssociationConfig(), ["a", "b", "c", "d"])
    assert f"view {'abcd'[view]} look as if" in line and f"a video of {size} the size" in line
