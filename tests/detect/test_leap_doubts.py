"""People whose tracks go over to somebody else who comes in near by."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from perfcap.detect import associate
from perfcap.detect.association.leap_doubts import leap_doubts
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.io import read_cameras, read_detections

TRIO = Path(__file__).parents[3] / "shared" / "data" / "rendered_multi" / "dev_trio"
needs_data = pytest.mark.skipif(not TRIO.is_dir(), reason="needs the rendered views")
FRAMES, RATE = 36, 30.0


def walkers(people: int = 2) -> Tensor:
    """Joints of people who walk at 1.5 m/s on a curve, with two centimetres of noise."""
    random = torch.Generator().manual_seed(0)
    angle = torch.linspace(0, 2, FRAMES, dtype=torch.float64)
    way = (1.5 / RATE * torch.stack((angle.cos(), 0 * angle, angle.sin()), -1)).cumsum(0)
    noise = 0.02 * torch.randn(people, FRAMES, 16, 3, generator=random, dtype=torch.float64)
    apart = torch.arange(people, dtype=torch.float64)[:, None, None, None]
    return way[:, None] + noise + apart


def test_who_walks_on_is_the_same() -> None:
    points = walkers()
    assert not list(leap_doubts(points, RATE))
    points[0, 12:17] = torch.nan
    points[1, ::3] = torch.nan
    points[1, 20, 3] += 1.0  # one joint alone
    assert not list(leap_doubts(points, RATE))
    assert not list(leap_doubts(torch.full_like(points, torch.nan), RATE))


@pytest.mark.parametrize("gap", [0, 3])
def test_who_comes_in_near_by_is_another(gap: int) -> None:
    points = walkers()
    points[1, 18:] += torch.tensor([0.4, 0.0, 0.4])
    points[1, 18 : 18 + gap] = torch.nan
    (told,) = leap_doubts(points, RATE)
    assert told.startswith("person 2 leaps 0.")
    assert f"m aside between frames 17 and {18 + gap} (counted from 0)" in told
    points[1, 18:30] = torch.nan  # time enough for anything
    assert not list(leap_doubts(points, RATE))


def crowd(frames: dict[int, slice]) -> tuple[Camera, Detections, list[Tensor]]:
    """Four views of people, each listed in some frames alone; and where they are."""
    rig = read_cameras(TRIO / "cameras.json").select([0, 1, 2, 3])
    people = [
        read_detections([TRIO / f"person{k}" / "detections.npz"], views=6)[0].select([0, 1, 2, 3])
        for k in frames
    ]
    places = torch.stack([each.joints2d for each in people]).double()
    sure = torch.zeros_like(places[..., 0])
    for own, each, part in zip(sure, people, frames.values(), strict=True):
        own[part] = each.confidence2d[part].double()
    trusted = torch.zeros(places.shape[:3], dtype=torch.bool)
    truth = [torch.from_numpy(np.load(TRIO / f"person{k}/gt.npz")["joints3d"]) for k in frames]
    return rig.cameras, Detections(places, sure, None, trusted), truth


@needs_data
@pytest.mark.long
def test_one_leaves_and_another_comes_in() -> None:
    cameras, seen, _ = crowd({2: slice(36), 1: slice(36), 3: slice(36)})
    assert not any("leaps" in note for note in associate(cameras, seen, RATE).notes)
    cameras, seen, _ = crowd({2: slice(36), 1: slice(18), 3: slice(21, 36)})
    found = associate(cameras, seen, RATE)
    assert len(found.people) == 2
    (told,) = [note for note in found.notes if "leaps" in note]
    assert "has one left and another come in?" in told


@needs_data
@pytest.mark.long
@pytest.mark.parametrize(
    "frames",
    [
        {1: slice(36), 2: slice(18, 36), 3: slice(18)},
        {1: slice(36), 2: slice(22), 3: slice(22, 36)},
    ],
)
def test_who_stays_keeps_the_track(frames: dict[int, slice]) -> None:
    """Rather than everybody being shifted by one, the one who left has no group any more."""
    cameras, seen, truth = crowd(frames)
    found = associate(cameras, seen, RATE)
    apart = [(each - truth[0]).norm(dim=-1).nanmedian(-1).values for each in found.points]
    assert min(float(each.nan_to_num().max()) for each in apart) < 0.1
