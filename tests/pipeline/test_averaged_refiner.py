"""What people do to a model with a refiner in it: moving averages, derivatives forwards."""

from __future__ import annotations

import copy
import warnings
from typing import Any

import pytest
import torch
from takes import make_take
from torch.autograd import forward_ad
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from perfcap.errors import InputError
from perfcap.pipeline import PoseRefiner, capture

TAKE = make_take(10)


def joints(model: torch.nn.Module) -> torch.Tensor:
    seen = TAKE.detections
    with torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        refined = model(TAKE.cameras, seen.joints2d, seen.confidence2d, seen.joints3d)
    found: torch.Tensor = refined.joints
    return found


def averaged(layer: PoseRefiner, *, buffers: bool) -> torch.nn.Module:
    mean = AveragedModel(layer, multi_avg_fn=get_ema_multi_avg_fn(0.9), use_buffers=buffers)
    for _ in range(3):
        mean.update_parameters(layer)
    module: torch.nn.Module = mean.module
    return module.eval()


def test_a_mean_of_whole_numbers_is_refused() -> None:
    """Parents of joints were one less, and limbs hung elsewhere, with no word."""
    layer = PoseRefiner(copy.deepcopy(TAKE.actor), rate=TAKE.rate).eval()
    with pytest.raises(InputError, match="numbers of its joints, were changed, as by a moving"):
        joints(averaged(layer, buffers=True))
    with pytest.raises(InputError, match="numbers of its joints, were changed, as by a moving"):
        actor: Any = averaged(layer, buffers=True).actor
        capture(actor, TAKE.cameras, TAKE.detections, TAKE.rate)
    expected = joints(layer)
    assert torch.equal(joints(averaged(layer, buffers=False)), expected)
    assert torch.equal(joints(copy.deepcopy(layer)), expected)
    other = PoseRefiner(copy.deepcopy(TAKE.actor), rate=TAKE.rate).eval()
    other.load_state_dict(layer.state_dict())
    assert torch.equal(joints(other), expected)


@pytest.mark.long
@pytest.mark.parametrize("listed", [False, True])
def test_derivatives_forwards_are_refused(listed: bool) -> None:
    """They were others than those of backward(), and of central differences."""
    layer, seen = PoseRefiner(TAKE.actor, rate=TAKE.rate), TAKE.detections

    def refined(joints2d: torch.Tensor) -> torch.Tensor:
        found: torch.Tensor = layer(TAKE.cameras, [joints2d] if listed else joints2d).joints
        return found

    one = torch.ones_like(seen.joints2d)
    with pytest.raises(InputError, match=r"take gradients by backward\(\)"):
        torch.func.jvp(refined, (seen.joints2d,), (one,))
    with forward_ad.dual_level(), pytest.raises(InputError, match="take gradients by backward"):
        refined(forward_ad.make_dual(seen.joints2d, one))  # type: ignore[no-untyped-call]
    parts = {name: part.detach() for name, part in layer.named_parameters()}
    called = torch.func.functional_call(layer, parts, (TAKE.cameras, seen.joints2d)).joints
    assert torch.equal(called, layer(TAKE.cameras, seen.joints2d).joints)
