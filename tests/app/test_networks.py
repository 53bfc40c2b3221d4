"""Networks run over the views of a clip: several people, and what is kept of them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from takes import make_take
from tiny_networks import MANIFESTS, body, draw, vitpose, write_model
from tiny_people import write_people

from perfcap.app.networks import Detecting, detect_everybody, open_networks
from perfcap.commands.capture import Capture
from perfcap.commands.views import DEFAULT_DETECTORS, FINDER
from perfcap.detect.joint_set import COCO17, map_to_landmarks
from perfcap.errors import InputError
from perfcap.io.clip import Clip
from perfcap.pipeline.checkpoint import Checkpoint

SIZE = (192, 288)
TALL = 110.0
CORNERS = np.array([[20.0, 40.0], [190.0, 45.0]])
FRAMES = 3


def places(view: int, frame: int) -> np.ndarray:
    """Joints of two people, (2, 17, 2): each in a half, which they do not leave."""
    return CORNERS[:, None] + TALL * body(17) + [2.0 * frame, 3.0 * view]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    folder = tmp_path_factory.mktemp("views")
    for view in range(2):
        (folder / f"cam{view}").mkdir()
        for frame in range(FRAMES):
            both = [draw(SIZE, each, 3.2) for each in places(view, frame)]
            image = np.ascontiguousarray(np.maximum(*both)[..., ::-1])
            cv2.imwrite(str(folder / f"cam{view}" / f"{frame:03d}.png"), image)
    return Clip.open(sorted(folder.iterdir()))


@pytest.fixture(scope="module")
def detecting(tmp_path_factory: pytest.TempPathFactory) -> Detecting:
    folder = tmp_path_factory.mktemp("networks")
    close = write_model(folder / "close", vitpose(), MANIFESTS["vitpose"])
    finder, detectors = open_networks([str(write_people(folder)), str(close)])
    assert finder is not None and len(detectors) == 1
    return Detecting(detectors, people=2, finder=finder)


def test_everybody_is_found_in_every_view(clip: Clip, detecting: Detecting) -> None:
    found = detect_everybody(clip, detecting, make_take(FRAMES, views=2).cameras)
    assert found.joints2d.shape == (2, FRAMES, 2, 16, 2) and found.joints3d is None
    for view in range(2):
        for frame in range(FRAMES):
            truth = torch.from_numpy(places(view, frame)).float()
            known = map_to_landmarks(truth, torch.ones(2, 17), COCO17)[0]
            apart = (found.joints2d[:, None, frame, view] - known).norm(dim=-1)  # P K 16
            seen = found.confidence2d[:, frame, view] > 0.3
            assert seen.double().mean() > 0.7
            near = torch.stack([apart[p, :, seen[p]].median(-1).values for p in range(2)])
            assert near.amin(0).max() < 2, "both people, one each"


def test_what_networks_answered_is_kept(
    clip: Clip, detecting: Detecting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unwanted(*_: Any) -> None:
        raise AssertionError("a network was asked again")

    kept = replace(detecting, checkpoint=Checkpoint(tmp_path))
    cameras = make_take(FRAMES, views=2).cameras
    first = detect_everybody(clip, kept, cameras)
    monkeypatch.setattr(type(detecting.detectors[0]), "estimate", unwanted)
    again = detect_everybody(clip, kept, cameras)
    torch.testing.assert_close(again.joints2d, first.joints2d, rtol=0, atol=0)
    torch.testing.assert_close(again.confidence2d, first.confidence2d, rtol=0, atol=0)


def test_an_empty_room_is_named(detecting: Detecting, tmp_path: Path) -> None:
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder in folders:
        folder.mkdir()
        cv2.imwrite(str(folder / "0.png"), np.zeros((*SIZE, 3), np.uint8))
    with pytest.raises(InputError, match="a, b: nobody is found in any frame"):
        detect_everybody(Clip.open(folders), detecting, make_take(1, views=2).cameras)


@pytest.mark.long
def test_a_finder_is_the_first_default_network_of_several_people() -> None:
    videos = (Path("a.mp4"), Path("b.mp4"))
    alone, pair = Capture(videos=videos), Capture(videos=videos, people=2)
    assert alone.detectors == DEFAULT_DETECTORS
    assert pair.detectors == (FINDER, *DEFAULT_DETECTORS)
    assert Capture(videos=videos, actor=("me", "you")).detectors == pair.detectors
    assert replace(pair, detector=("thunder",)).detectors == ("thunder",)
    assert replace(pair, detections=(Path("d.npz"),)).detectors == ()
    finder, others = open_networks(pair.detectors)
    assert finder is not None and len(others) == len(DEFAULT_DETECTORS)
