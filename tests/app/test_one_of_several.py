"""One person of several in videos: enough people are followed to say who is the same."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch
from synthetic import cameras as circle

from perfcap.app import networks
from perfcap.app.networks import Detecting
from perfcap.detect.detections import Detections
from perfcap.detect.people import OnnxFinder

FRAMES = 4


@dataclass
class Videos:
    names: tuple[str, ...] = ("left", "right")
    views: int = 2

    def __len__(self) -> int:
        return FRAMES


@pytest.mark.parametrize(("people", "followed"), [(1, 2), (2, 2), (3, 3)])
def test_two_are_followed_where_one_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, people: int, followed: int
) -> None:
    """The surest of two views were different people, and became one who was 15 cm too tall."""
    asked = []

    def follow(first: Any, frames: Any, finder: Any, count: int, *more: Any) -> list[Detections]:
        asked.append(count)
        one = Detections.from_joints(torch.ones(FRAMES, 1, 16, 2), torch.ones(FRAMES, 1, 16))
        return [one] * count

    monkeypatch.setattr(networks, "follow_people", follow)
    network = cast(Any, SimpleNamespace(manifest=None, kernel=None))
    detecting = Detecting((network,), people=people, finder=cast(OnnxFinder, object()))
    found = networks.detect_everybody(cast(Any, Videos()), detecting, circle(2))
    assert asked == [followed] * 2
    assert found.confidence2d.shape == (followed, FRAMES, 2, 16)
