"""What a state_dict does to an actor that is another one."""

from __future__ import annotations

import warnings

import pytest
import torch
from synthetic import actor
from torch import nn

from perfcap.actor.actor import Actor
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
        PoseRefiner(actor()).load_state_dict(alone, strict=False)
