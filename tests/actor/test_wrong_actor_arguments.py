"""What is no surface, rig or bone length of an actor is named; what is, is not."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import pytest
import torch
from synthetic import actor

from perfcap.actor.actor import Actor
from perfcap.actor.rig import with_limits
from perfcap.errors import InputError

ACTOR = actor()
RIG = ACTOR.skeleton.rig
GROUPS = len(ACTOR.skeleton.group_names)


@pytest.mark.parametrize(
    ("factor", "shift"), [(1000.0, (0.0, 0.0, 0.0)), (1.0, (0.03, 0.0, 0.0)), (-1.0, (0.0,) * 3)]
)
def test_a_rig_of_another_person_is_named(factor: float, shift: tuple[float, ...]) -> None:
    """The mesh of one person turned about the joints of another, or about none."""
    other = replace(RIG, positions=factor * RIG.positions + torch.tensor(shift).to(RIG.positions))
    with pytest.warns(UserWarning, match=r"the rig is not that of .* m from its bone"):
        Actor(ACTOR.template, other)


def test_a_rig_of_the_template_is_right() -> None:
    hinge = RIG.hinges[0]
    longer = ACTOR.resized(torch.full((GROUPS,), 0.3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        limited = Actor(ACTOR.template, with_limits(RIG, {hinge.name: (-0.1, 0.1)}))
        assert limited.skeleton.angle_names == ACTOR.skeleton.angle_names
        same = Actor(longer.template, longer.skeleton.rig)
    torch.testing.assert_close(same.skeleton.rest_landmarks, longer.skeleton.rest_landmarks)


@pytest.mark.parametrize("scale", [1000.0, 0.001])
def test_a_surface_of_another_unit_is_named(scale: float) -> None:
    motion = ACTOR.skeleton.rest_motion(2)
    surface = ACTOR.surface(motion).detach()
    with pytest.warns(UserWarning, match="at_rest: the surface comes to rest .* times as large"):
        ACTOR.at_rest(motion, scale * surface)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ACTOR.at_rest(motion, surface)


def test_degrees_are_named_on_the_way_to_rest() -> None:
    motion = ACTOR.skeleton.rest_motion(2)
    surface = ACTOR.surface(motion).detach()
    with pytest.warns(UserWarning, match="these look like degrees"):
        ACTOR.at_rest(replace(motion, angles=motion.angles + 90), surface)


def test_factors_are_no_logarithms() -> None:
    """Factors of about 1 made a giant of a person."""
    with pytest.warns(UserWarning, match=r"these look like the factors: give torch.log"):
        ACTOR.resized(torch.full((GROUPS,), 1.05))
    for percent in (105.0, math.nan):
        with pytest.raises(InputError, match="expected logarithms of factors of length"):
            ACTOR.resized(torch.full((GROUPS,), percent))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for factor in (0.6, 1.0, 1.6):
            ACTOR.resized(torch.full((GROUPS,), math.log(factor)))
