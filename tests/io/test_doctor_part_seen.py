"""Right views of people who are seen in a part of a clip alone."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.io import read_cameras, read_detections
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import examine_agreement

DATA = Path(__file__).parents[2] / "../shared/data/rendered_multi"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="needs ../shared/data/rendered_multi")


def clip(name: str, person: int, frames: slice, views: list[int]) -> tuple[CameraRig, Detections]:
    """Some views of a part of a recording, without 3D poses."""
    rig = read_cameras(DATA / name / "cameras.json")
    path = DATA / name / f"person{person}" / "detections.npz"
    seen, _ = read_detections([path], views=rig.names, pixel_offset=rig.pixel_offset)
    return rig.select(views), seen.frames(frames).select(views).without_poses()


def unseen(seen: Detections, away: Tensor, faint: float = 0.0) -> Detections:
    """Noise of hardly any confidence where the person is away, (F, C)."""
    random = torch.Generator().manual_seed(0)
    noise = 20 * torch.randn(seen.joints2d.shape, generator=random).to(seen.joints2d)
    joints = torch.where(away[..., None, None], seen.joints2d[:1] + noise, seen.joints2d)
    confidence = torch.where(away[..., None], faint, seen.confidence2d)
    return replace(seen, joints2d=joints, confidence2d=confidence)


@needs_data
@pytest.mark.long
@pytest.mark.parametrize("faint", [0.0, 0.15])
def test_who_leaves_one_view_after_the_other_is_not_swapped(faint: float) -> None:
    rig, seen = clip("dev_trio", 2, slice(4, 34), [2, 4])
    away = torch.arange(30)[:, None] >= torch.tensor([15, 18])
    assert not [x for x in examine_agreement(rig, unseen(seen, away, faint)) if "swap" in x.what]


@needs_data
@pytest.mark.long
@pytest.mark.parametrize("faint", [0.0, 0.15])
def test_who_is_seen_amid_a_clip_is_no_one_else(faint: float) -> None:
    rig, seen = clip("dev_twins", 2, slice(0, 36), [4, 3, 2, 1])
    away = ((torch.arange(36) < 9) | (torch.arange(36) >= 27))[:, None].expand(36, 4)
    assert not examine_agreement(rig, unseen(seen, away, faint))
    exchanged = unseen(seen, away, faint).select([1, 0, 2, 3])
    assert any("look exchanged" in x.what for x in examine_agreement(rig, exchanged))
