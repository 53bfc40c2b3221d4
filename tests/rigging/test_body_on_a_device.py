"""A body is fitted where its model, cameras and joints lie."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import pytest
import torch
from bodies import QUICK, person, seen
from pretended_card import CARD
from synthetic import cameras
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import BODY
from perfcap.rigging.fit_body import fit_body
from perfcap.rigging.person_masks import PersonMasks


@pytest.mark.long
def test_a_body_is_the_same_on_a_device(model: BodyModel) -> None:
    views, truth = cameras(4, size=200, distance=4.0).select([0, 1]), person(model)
    joints, masks = seen(model, truth, views)
    start = replace(truth, translation=truth.translation + 0.02, shared={})

    def run(device: str | torch.device) -> Tensor:
        like = torch.zeros(0, dtype=torch.float64, device=device)
        given = views.to(like), joints.to(like), start.to(like)
        shown = PersonMasks(given[0], masks.to(like.device))
        body = deepcopy(model).to(like.device)
        return fit_body(body, *given, shown, settings=QUICK).motion.shared[BODY]

    there = run(CARD)
    assert there.device == CARD
    torch.testing.assert_close(there.cpu(), run("cpu"), rtol=0, atol=1e-3)
