"""What actors say of the state of another one, and of motions in degrees."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from synthetic import actor
from torch import Tensor, nn

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.pipeline import PoseRefiner


def taller() -> Actor:
    own = actor()
    return own.resized(torch.full((len(own.skeleton.group_names),), 0.1, dtype=torch.float64))


def test_the_state_of_another_actor_is_said() -> None:
    """As weights learned with one person that are loaded for the next."""
    state = PoseRefiner(taller(), learn_weights=True).state_dict()
    layer = PoseRefiner(actor(), learn_weights=True)
    with pytest.warns(UserWarning, match=r"actor than 'tubes'.* its keys .actor\."):
        layer.load_state_dict(state)
    with pytest.warns(UserWarning, match="Make the module of that actor first$"):
        actor().load_state_dict(taller().state_dict())
    with pytest.warns(UserWarning, match=r"its keys .0\.actor\.\*."):
        inner = {f"0.{key}": part for key, part in state.items()}
        nn.Sequential(PoseRefiner(actor(), learn_weights=True)).load_state_dict(inner)


def test_its_own_state_is_not() -> None:
    own = PoseRefiner(taller()).state_dict()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        PoseRefiner(taller()).load_state_dict(own)
        PoseRefiner(taller()).float().load_state_dict(own)  # in another precision
        alone = {key: part for key, part in own.items() if not key.startswith("actor.")}
        lacking = PoseRefiner(actor()).load_state_dict(alone, strict=False).missing_keys
    assert lacking and all(key.startswith("actor.") for key in lacking)


@pytest.mark.parametrize("ask", [Actor.joints, Actor.surface])
def test_angles_in_degrees_are_said(ask: Callable[[Actor, Motion], Tensor]) -> None:
    """As those read back from a table, which has degrees."""
    own = actor()
    motion = bent(own, 0.6)
    with pytest.warns(UserWarning, match=r"by 34\.4 radians .* torch\.deg2rad"):
        ask(own, replace(motion, angles=motion.angles.rad2deg()))
    with pytest.warns(UserWarning, match="these look like degrees"):
        ask(own, replace(motion, rotation=torch.full_like(motion.rotation, 90.0)))


def test_turns_in_radians_are_not() -> None:
    """Whole turns of the root, and one wild frame in three."""
    own = actor()
    motion = bent(own, 0.6)
    wild = motion.angles.clone()
    wild[0] = 50.0
    turn = torch.tensor([0.0, 1.0, 0.0]).to(motion.rotation).expand_as(motion.rotation)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        thrice = own.joints(replace(motion, rotation=3 * math.pi * turn))
        surface = own.surface(replace(motion, angles=wild))
        every = torch.func.vmap(lambda angles: own.joints(replace(motion, angles=angles)))
        torch.testing.assert_close(every(wild[None])[0], own.joints(replace(motion, angles=wild)))
    torch.testing.assert_close(thrice, own.joints(replace(motion, rotation=math.pi * turn)))
    assert surface.isfinite().all()


def bent(own: Actor, angle: float) -> Motion:
    rest = own.skeleton.rest_motion(3)
    return replace(rest, angles=torch.full_like(rest.angles, angle))
