"""Joints that a filter with zeros beside the clip pulled to the corner of the image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.io.doctor.given import examine_given
from perfcap.io.doctor.shrunk import examine_shrunk

TAKE = make_take(40, lifted=False)
PIXELS, SURE = TAKE.detections.joints2d[:, 0], TAKE.detections.confidence2d[:, 0]


def mean(width: int) -> Tensor:
    """A moving average as numpy.convolve makes it."""
    window = np.ones(width) / width
    return torch.as_tensor(
        np.apply_along_axis(lambda path: np.convolve(path, window, "same"), 0, PIXELS.numpy())
    )


@pytest.mark.parametrize("width", [3, 5, 9, 15, 25])
def test_both_ends_of_a_moving_average_are_named(width: int) -> None:
    (found,) = examine_shrunk("view", 0, mean(width), SURE)
    assert "shrinks towards the corner" in found.what and found.views == (0,)
    assert {0, 39} <= set(found.frames) and 20 not in found.frames


def test_a_mean_that_begins_with_zero_is_named() -> None:
    joints, held = [], torch.zeros_like(PIXELS[0])
    for each in PIXELS:
        held = (held + each) / 2
        joints.append(held)
    (found,) = examine_shrunk("view", 0, torch.stack(joints), SURE)
    assert found.frames[0] == 0 and found.frames[-1] < 5


def test_sound_joints_are_not() -> None:
    assert not examine_shrunk("view", 0, PIXELS, SURE)
    window = torch.ones(1, 1, 9, dtype=PIXELS.dtype) / 9
    paths = PIXELS.flatten(1).T[:, None]
    smooth = torch.nn.functional.conv1d(
        torch.nn.functional.pad(paths, (4, 4), mode="replicate"), window
    )
    assert not examine_shrunk("view", 0, smooth[:, 0].T.reshape(PIXELS.shape), SURE)


@pytest.mark.parametrize("towards", [(0.5, 0.5), (0.25, 0.75), (1.0, 0.3)])
def test_who_comes_nearer_fast_is_not(towards: tuple[float, float]) -> None:
    """And stops, by half their size in five frames: they grow about where they come from."""
    centre = 2 * PIXELS.mean((0, 1)) * torch.tensor(towards)
    scale = (0.66 + 0.34 * (torch.arange(40) / 5).clamp(max=1))[:, None, None]
    assert not examine_shrunk("view", 0, centre + scale * (PIXELS - centre), SURE)


def test_every_way_in_names_it() -> None:
    seen = replace(TAKE.detections, joints2d=mean(9)[:, None])
    assert any("shrinks" in str(each) for each in examine_given(TAKE.cameras, seen))
    assert not any("shrinks" in str(each) for each in examine_given(TAKE.cameras, TAKE.detections))
