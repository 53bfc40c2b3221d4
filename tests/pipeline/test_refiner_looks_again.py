"""A layer examines its first batch, and later ones now and then, of each mode and kind."""

from __future__ import annotations

import warnings

import pytest
import torch
from takes import make_take

from perfcap.pipeline import PoseRefiner
from perfcap.pipeline.config import PoseConfig

TAKE = make_take(12, views=2)
ONE = TAKE.cameras.select([0])
PIXELS = TAKE.detections.joints2d
EXCHANGED = PIXELS.flip(-1)  # y before x
SHORT = PoseConfig(max_steps=2)


def said(layer: PoseRefiner, *given: object, **more: object) -> str:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        layer(*given, **more)  # type: ignore[arg-type]
    return " ".join(str(each.message) for each in found)


def told(layer: PoseRefiner, *given: object, **more: object) -> bool:
    with torch.no_grad():
        return "x and y" in said(layer, *given, **more)


@pytest.mark.long
def test_later_batches_are_examined_now_and_then() -> None:
    """A first batch of a network that knew nothing yet was all that it ever looked at."""
    layer = PoseRefiner(TAKE.actor, config=SHORT)
    assert not told(layer, ONE, PIXELS[:, :1])
    later = [told(layer, ONE, EXCHANGED[:, :1]) for _ in range(2, 12)]
    assert later == [batch == 10 for batch in range(2, 12)]


@pytest.mark.long
def test_each_mode_and_kind_is_examined() -> None:
    layer = PoseRefiner(TAKE.actor, config=SHORT)
    poses = TAKE.detections.joints3d
    assert poses is not None
    assert not told(layer, ONE, PIXELS[:, :1])
    assert told(layer, TAKE.cameras, EXCHANGED)
    assert told(layer, ONE, EXCHANGED[:, :1], joints3d=poses[:, :1])
    layer.eval()
    assert told(layer, ONE, EXCHANGED[:, :1]) and not told(layer, ONE, EXCHANGED[:, :1])


@pytest.mark.long
def test_a_network_that_stays_unsure_is_told_of() -> None:
    """Confidences that are next to nothing have no gradient; a new network's may be for a while."""
    layer = PoseRefiner(TAKE.actor, config=SHORT)
    sure = torch.full(PIXELS.shape[:-1], 1e-9, dtype=PIXELS.dtype)[:, :1].requires_grad_()
    found = [said(layer, ONE, PIXELS[:, :1], confidence2d=sure) for _ in range(100)]
    assert [batch for batch, what in enumerate(found, 1) if "confidences are 1e-09" in what] == [
        100
    ]
