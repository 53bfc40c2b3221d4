"""Joints that were cut off at the edges of the image."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from takes import make_take

from perfcap.io.doctor.edges import examine_edges
from perfcap.io.doctor.given import examine_given

TAKE = make_take(40)
PIXELS = TAKE.detections.joints2d[:, 0]
CUT = int(PIXELS[..., 1].flatten().quantile(0.8))  # lowest row but one of a smaller image
SIZE = (CUT + 1, 10000)


@pytest.mark.parametrize("offset", [0.0, 0.5, 1.0])
def test_joints_that_were_cut_off_are_named(offset: float) -> None:
    cut = PIXELS.flatten(0, 1).clone()
    cut[:, 1] = cut[:, 1].clamp(max=CUT) + offset
    (found,) = examine_edges("view", cut, SIZE)
    assert "joints with confidence lie on the lower edge to the last digit" in found.what


def test_sound_joints_are_not() -> None:
    flat = PIXELS.flatten(0, 1)
    inside = flat[flat[:, 1] < CUT]
    assert not examine_edges("view", flat, SIZE) and not examine_edges("view", inside, SIZE)
    assert not examine_edges("view", inside.round(), SIZE)
    assert not examine_edges("view", inside[:0], SIZE)
    assert not examine_edges("view", torch.zeros(100, 2), SIZE)  # placeholders, which others name


def test_every_way_in_names_them() -> None:
    seen, cameras = TAKE.detections, replace(TAKE.cameras, size=(SIZE,))
    joints = seen.joints2d.clone()
    joints[..., 1] = joints[..., 1].clamp(max=CUT)
    told = [str(each) for each in examine_given(cameras, replace(seen, joints2d=joints))]
    assert any("lower edge" in each for each in told)
    told = [str(each) for each in examine_given(cameras, seen)]
    assert not any("edge" in each for each in told)
