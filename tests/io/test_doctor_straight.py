"""Joints on lines and splines, as where gaps and the frames between keys were interpolated."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.finding import Finding
from perfcap.io.doctor.given import examine_given
from perfcap.io.doctor.straight import examine_straight
from perfcap.pipeline.pose_refiner import PoseRefiner

TAKE = make_take(40)
PIXELS = TAKE.detections.joints2d[:, 0]
EVERY = torch.ones(40, 16, dtype=torch.bool)
WRIST = LANDMARKS.index("r_wrist")
LEGS = [n for n, name in enumerate(LANDMARKS) if name.endswith(("knee", "ankle", "toe"))]


def line(joints: Tensor, first: int, last: int, some: list[int]) -> Tensor:
    """Joints (F, ..., J, D) of which some are interpolated between two frames."""
    filled = joints.clone()
    for frame in range(first + 1, last):
        share = (frame - first) / (last - first)
        filled[frame, ..., some, :] = (
            joints[first, ..., some, :] * (1 - share) + joints[last, ..., some, :] * share
        )
    return filled


def told(joints: Tensor) -> list[Finding]:
    return examine_straight("view", 0, joints, EVERY)


@pytest.mark.parametrize("digits", [12, 3])
def test_a_gap_that_was_filled_is_named(digits: int) -> None:
    (found,) = told(line(PIXELS, 10, 30, [WRIST]).round(decimals=digits))
    assert "r_wrist (19 frames), in frames 11-29 (of the capture" in found.what
    assert found.frames == () and found.views == ()  # the others bear the pose out
    (found,) = told(line(PIXELS, 10, 30, LEGS).round(decimals=digits).float())
    assert "and 2 more" in found.what and found.frames == tuple(range(11, 30))
    assert found.views == (0,)


def test_keys_are_named() -> None:
    """As of a program in which every fifth frame was marked by hand."""
    joints = PIXELS
    for first in range(0, 35, 5):
        joints = line(joints, first, first + 5, list(range(16)))
    (found,) = told(joints)
    assert "frames 1-4, 6-9, 11-14" in found.what and len(found.frames) == 28


@pytest.mark.parametrize("digits", [12, 3])
def test_splines_are_named(digits: int) -> None:
    """Cubics that leave and arrive at the speed of the joint."""
    filled = PIXELS.clone()
    share = (torch.arange(21) / 20)[:, None]
    first, last = PIXELS[10, WRIST], PIXELS[30, WRIST]
    leaves, arrives = 20 * (first - PIXELS[9, WRIST]), 20 * (PIXELS[31, WRIST] - last)
    filled[10:31, WRIST] = (
        first
        + share * leaves
        + share**2 * (3 * (last - first) - 2 * leaves - arrives)
        + share**3 * (2 * (first - last) + leaves + arrives)
    )
    (found,) = told(filled.round(decimals=digits))
    assert "r_wrist (19 frames), in frames 11-29 (of the capture" in found.what


def test_short_gaps_and_sound_joints_are_not() -> None:
    assert not told(PIXELS) and not told(PIXELS.half().float())
    assert not told(line(PIXELS, 10, 15, [WRIST]))  # 4 frames once
    unseen = EVERY.clone()
    unseen[11:30, WRIST] = False
    assert not examine_straight("view", 0, line(PIXELS, 10, 30, [WRIST]), unseen)
    steady = torch.arange(40.0)[:, None, None] + PIXELS[:1]  # nothing bends anywhere
    assert not told(steady) and not told(PIXELS[:1].expand(40, 16, 2))


def test_whole_pixels_are_not() -> None:
    """Of who moves evenly: their places are a line here and there."""
    time = torch.arange(40.0)[:, None, None]
    drift = PIXELS[:1] + 1.05 * time + 3 * torch.sin(time / 8)
    assert not told(drift.round())


@pytest.mark.long
def test_every_way_in_names_them() -> None:
    seen = TAKE.detections
    assert seen.joints3d is not None
    for part in ("joints2d", "joints3d"):
        filled = replace(seen, **{part: line(getattr(seen, part), 10, 30, LEGS)})
        told = [str(each) for each in examine_given(TAKE.cameras, filled)]
        assert len([each for each in told if "along straight lines" in each]) == 1, told
    refiner = PoseRefiner(TAKE.actor, rate=TAKE.rate)
    joints = line(seen.joints2d, 10, 30, LEGS)
    with pytest.warns(UserWarning, match="along straight lines"):
        refiner(TAKE.cameras, joints, seen.confidence2d, seen.joints3d)
