"""Right views of people, of whom no change may seem to be the better."""

import pytest
from crowds import make_crowd

from perfcap.detect.association.sightings import AssociationConfig
from perfcap.detect.association.view_doubts import view_doubts


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("views", [2, 4])
@pytest.mark.parametrize("noise", [6.0, 10.0])
def test_right_views_of_unsure_joints(seed: int, views: int, noise: float) -> None:
    """Joints fit better the smaller people are, since errors in metres are smaller with them."""
    crowd = make_crowd(seed, views=views, noise=noise)
    assert view_doubts(crowd.cameras, crowd.candidates, AssociationConfig()) == ()


def test_a_few_frames_say_nothing() -> None:
    crowd = make_crowd(1)
    exchanged = crowd.candidates.select([3, 1, 2, 0])
    config = AssociationConfig()
    assert view_doubts(crowd.cameras, exchanged.frames(slice(0, 5)), config) == ()
    assert "look exchanged" in view_doubts(crowd.cameras, exchanged.frames(slice(0, 12)), config)[0]
