"""One person in videos: a network that finds people watches for others, by default."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch
from synthetic import cameras as circle

from perfcap.app import networks
from perfcap.app.networks import Detecting, detect_clip, open_watcher
from perfcap.commands.capture import Capture
from perfcap.detect import onnx
from perfcap.detect.detections import Detections
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.people import OnnxFinder
from perfcap.detect.person import Start
from perfcap.io.actor import models_folder

VIDEOS = (Path("dance.mp4"),)


class Clip:
    names: tuple[str, ...] = ("left", "right")
    views: int = 2

    def __len__(self) -> int:
        return 4


def followed(monkeypatch: pytest.MonkeyPatch, module: Any) -> list[Start]:
    """How people are followed from now on."""
    starts: list[Start] = []

    def follow(network: Any, frames: Any, start: Start, *more: Any) -> Detections:
        starts.append(start)
        return Detections.from_joints(torch.ones(4, 1, 16, 2), torch.ones(4, 1, 16))

    monkeypatch.setattr(module, "follow_person", follow)
    return starts


@pytest.mark.parametrize(
    ("request_", "name"),
    [
        (Capture(videos=VIDEOS), "multipose"),
        (Capture(videos=VIDEOS, people=2), None),
        (Capture(videos=VIDEOS, detector=("thunder",)), None),
        (Capture(videos=VIDEOS, detections=VIDEOS), None),
    ],
    ids=["video alone", "everybody", "networks that are named", "joints that are given"],
)
def test_the_default_networks_are_watched_over(request_: Capture, name: str | None) -> None:
    assert request_.watcher == name
    found = open_watcher(request_.watcher)
    assert (found is None) is (name is None)
    assert found is None or found.manifest.path.parent.name == name


def test_every_view_is_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    starts = followed(monkeypatch, networks)
    network = cast(Any, SimpleNamespace(manifest=None, kernel=None))
    finder, watcher = (cast(OnnxFinder, object()) for _ in range(2))
    for detecting, one in (
        (Detecting((network,), watcher=watcher), watcher),
        (Detecting((network,), finder=finder), finder),
        (Detecting((network,)), None),
    ):
        starts.clear()
        detect_clip(cast(Any, Clip()), detecting, circle(2))
        assert [start.watcher for start in starts] == [one] * 2
        assert [start.finder for start in starts] == [detecting.finder] * 2


def test_a_finder_of_a_detector_watches_too(monkeypatch: pytest.MonkeyPatch) -> None:
    starts = followed(monkeypatch, onnx)
    detector = OnnxDetector(models_folder() / "detectors" / "lightning")
    finder = cast(OnnxFinder, object())
    detector(torch.zeros(4, 1, 3, 32, 32), finder=finder)
    assert starts == [Start(None, finder=finder, watcher=finder)]
