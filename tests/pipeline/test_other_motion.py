"""A surface beside a motion that is another one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from takes import make_take

from perfcap.pipeline import CaptureConfig
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface

FRAMES = 20


@pytest.fixture(scope="module")
def surfaced() -> Performance:
    """With a surface that clothes and images moved a little from the skin."""
    take = make_take(FRAMES)
    found = Performance(
        take.actor, take.cameras, take.detections, take.truth, take.rate, CaptureConfig()
    )
    vertices = SkinnedSurface(take.actor, take.truth)[:]
    draw = torch.Generator().manual_seed(0)
    clothes = 0.012 * torch.randn(vertices.shape, generator=draw, dtype=vertices.dtype)
    return replace(found, surface=StoredSurface((vertices + clothes).float()))


def test_a_motion_beside_its_surface_is_told(surfaced: Performance, tmp_path: Path) -> None:
    motion = surfaced.motion
    near = replace(motion, translation=motion.translation + torch.tensor([0.06, 0.0, 0.0]))
    for other in (near, replace(motion, angles=motion.angles + 0.1)):
        with pytest.warns(UserWarning, match="the surface is not that of the motion: 9 of 9 "):
            replace(surfaced, motion=other).save(tmp_path)
    bare = replace(surfaced, motion=near, surface=None, trust=None, contact=None)
    bare.save(tmp_path)
    assert not (tmp_path / "surface.npz").exists()


def test_a_motion_elsewhere_than_its_joints_is_named(surfaced: Performance, tmp_path: Path) -> None:
    motion, found = surfaced.motion, replace(surfaced, surface=None)
    away = replace(motion, translation=motion.translation + torch.tensor([0.5, 0.0, 0.0]))
    millimetres = replace(motion, translation=1000 * motion.translation)
    for other in (away, millimetres):
        with pytest.warns(UserWarning, match=r"see the motion \d+% of the person's size from"):
            replace(found, motion=other).save(tmp_path)
    part = found.detections.frames(slice(9))
    replace(found, motion=millimetres[:9], detections=found.detections).save(tmp_path)
    replace(found, motion=motion[:9], detections=part).save(tmp_path)


def test_seconds_of_a_frame_are_no_rate(surfaced: Performance, tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="if a frame takes"):
        replace(surfaced, rate=1 / 30).save(tmp_path)


def test_a_surface_of_its_motion_and_one_wrong_frame_say_nothing(
    surfaced: Performance, tmp_path: Path
) -> None:
    surfaced.save(tmp_path)
    place = surfaced.motion.translation.clone()
    place[4:7] += 0.5
    replace(surfaced, motion=replace(surfaced.motion, translation=place)).save(tmp_path)
    assert (tmp_path / "surface.npz").exists()
