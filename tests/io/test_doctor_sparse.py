"""Joints of one in so many frames, and what is as smooth for another reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.interpolate import CubicSpline, PchipInterpolator, interp1d
from scipy.ndimage import gaussian_filter1d
from takes import make_take

from perfcap.io.doctor.given import examine_given
from perfcap.io.doctor.sparse import detected_period

FRAMES = 60
FILLS = interp1d, CubicSpline, PchipInterpolator
Fill = Callable[..., Callable[..., np.ndarray]]


def swaying(noise: float = 1.0) -> np.ndarray:
    """Joints (F, 16, 2) of who sways, with a detector's tremble."""
    rng = np.random.default_rng(2)
    time = np.arange(FRAMES)[:, None, None] / 30
    rate, phase, size = (rng.uniform(low, high, (16, 2))
                         for low, high in ((0.3, 1.5), (0, 6.3), (5, 60)))  # fmt: skip
    sway = 400 + size * np.sin(2 * np.pi * rate * time + phase)
    return np.asarray(sway + noise * rng.normal(size=sway.shape))


def put_in(joints: np.ndarray, fill: Fill, period: int, first: int = 0) -> np.ndarray:
    known = np.arange(first, len(joints), period)
    return fill(known, joints[known], axis=0)(np.arange(first, known[-1] + 1))


def period_of(joints: np.ndarray, known: np.ndarray | None = None) -> int:
    known = np.ones(joints.shape[:2], dtype=bool) if known is None else known
    return detected_period(torch.from_numpy(joints.copy()), torch.from_numpy(known))


@pytest.mark.parametrize("fill", FILLS)
@pytest.mark.parametrize("period", [4, 6, 8])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_the_period_is_found(fill: Fill, period: int, noise: float) -> None:
    joints = put_in(swaying(noise), fill, period)
    assert period_of(joints) == period
    assert period_of(np.round(joints, 2)) in (period, 0)


@pytest.mark.parametrize("width", [0.0, 0.6, 1, 2, 5])
@pytest.mark.parametrize("decimals", [0, 1, 2, 12])
def test_joints_of_every_frame_are_none(width: float, decimals: int) -> None:
    smooth = gaussian_filter1d(swaying(), width, axis=0) if width else swaying()
    assert not period_of(np.round(smooth, decimals))


def test_held_unseen_and_few_joints_are_none() -> None:
    assert not period_of(swaying()[np.arange(FRAMES) // 5 * 5])
    joints = put_in(swaying(), interp1d, 4)
    known = np.arange(len(joints)) % 4 == 0
    assert not period_of(joints, np.repeat(known[:, None], 16, 1))
    assert not period_of(joints[:12])


def test_every_way_in_says_so() -> None:
    take = make_take(41, lifted=False)
    seen = put_in(take.detections.joints2d.numpy(), interp1d, 4)
    findings = examine_given(take.cameras, replace(take.detections, joints2d=torch.tensor(seen)))
    assert any("joints of one in 4 frames were detected" in str(each) for each in findings)
    assert not any(
        "of one in" in str(each) for each in examine_given(take.cameras, take.detections)
    )
