"""``perfcap evaluate`` with a truth of other frames: of a clip that was cut, or backwards."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from perfcap.app.truth import FILE_PROTOCOL, FoundJoints, Truth
from perfcap.app.truth_doubts import joint_doubts
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.datasets import DatasetSequence

FRAMES = 260
LACKING = [LANDMARKS.index(name) for name in ("head_top", "r_toe", "l_toe")]  # as 3DPW does

REST = torch.rand(16, 3, generator=torch.Generator().manual_seed(0)).double()
REST = REST * torch.tensor([0.5, 1.7, 0.4]) + torch.tensor([0.0, 0.0, 4.0])


def smooth(frames: int, seed: int, width: float, shape: tuple[int, ...] = (16, 3)) -> Tensor:
    """Noise of deviation 1 that changes within so many frames, (F, *shape)."""
    noise = np.random.default_rng(seed).normal(size=(frames, *shape))
    at = np.arange(-int(4 * width), int(4 * width) + 1)
    window = np.exp(-0.5 * (at / width) ** 2)
    found = np.apply_along_axis(np.convolve, 0, noise, window, "same")
    return torch.from_numpy(found / found.std())


def motion(seed: int = 0) -> Tensor:
    """A person who moves limbs, never twice in the same way, and goes about, (F, 16, 3) m."""
    place = smooth(FRAMES, seed + 1, 20, (1, 3)) * torch.tensor([0.8, 0.0, 0.8])
    return REST + 0.12 * smooth(FRAMES, seed, 6) + place


def captured(joints: Tensor, size: float = 0.02) -> Tensor:
    """Joints (F, 16, 3) with the errors of a capture, m."""
    aside = torch.tensor([0.01, 0.0, 0.03])
    return joints + size * smooth(len(joints), 7, 4) + aside


def doubts(found: Tensor, true: Tensor, numbers: np.ndarray | None = None, **of: str) -> list[str]:
    """What is said of a result that counts from 0, (F, 16, 3), and a truth, (T, 16, 3), m."""
    if numbers is None:
        numbers = np.arange(len(true))
    dataset = of.get("dataset", "file")
    if dataset != "file":
        true = true.clone()
        true[:, LACKING] = torch.nan
        true[::41] = torch.nan
        true[12:17, 3] = torch.nan
    sequence = DatasetSequence(
        dataset, "t", Path("t"), torch.as_tensor(numbers), 30.0, joints3d=true
    )
    result = FoundJoints(Path("motion.npz"), found, np.arange(len(found)), 30.0)
    return joint_doubts(result, Truth(sequence, FILE_PROTOCOL, strict=False))


@pytest.mark.parametrize("dataset", ["file", "3dpw"])
@pytest.mark.parametrize("cut", [15, 40, 130])
def test_a_result_of_a_clip_that_was_cut(cut: int, dataset: str) -> None:
    """Its frames are counted from 0; data sets said nothing, as each lacks some landmark."""
    true = motion()
    (line,) = doubts(captured(true[cut : cut + 80]), true, dataset=dataset)
    assert f"with the truth of {cut} frames later" in line
    assert "check the numbers of its frames (a clip that was cut counts from 0)" in line


def test_a_long_clip_is_looked_at_in_some_frames_and_its_lag_is_exact() -> None:
    true = torch.cat([motion(seed) for seed in range(0, 50, 10)])
    (line,) = doubts(captured(true[61:]), true, dataset="3dpw")
    assert "with the truth of 61 frames later" in line


@pytest.mark.parametrize("late", [25, -25, 90, -90])
def test_a_truth_that_is_far_from_its_frames(late: int) -> None:
    true = motion()
    (line,) = doubts(captured(true), true, np.arange(FRAMES) + late, dataset="3dpw")
    assert f"of {abs(late)} frames {'later' if late > 0 else 'earlier'}" in line


def test_frames_are_looked_for_by_poses_in_another_world() -> None:
    true = motion()
    far = torch.tensor([9.0, 0.0, 5.0])
    (line,) = doubts(captured(true[40:120]) + far, true)
    assert "with the truth of 40 frames later" in line and "aligned frame by frame" in line


@pytest.mark.parametrize("dataset", ["file", "3dpw"])
def test_a_truth_in_reversed_order(dataset: str) -> None:
    true = motion()
    (line,) = doubts(captured(true), true.flip(0), dataset=dataset)
    assert line.startswith("with the truth in reversed order")
    (line,) = doubts(captured(true[:90]).flip(0), true, dataset=dataset)  # the video backwards
    assert line.startswith("with the truth in reversed order")


def test_of_motion_that_repeats_itself_the_smallest_lag_is_named() -> None:
    """Several lags fit as well: 20, 70 or -30 frames of a period of 50."""
    phase = 6 * torch.rand(16, 3, generator=torch.Generator().manual_seed(1)).double()
    turn = torch.arange(FRAMES)[:, None, None] * (2 * torch.pi / 50)
    true = REST + 0.12 * torch.sin(turn + phase)
    (line,) = doubts(captured(true[20:150]), true)
    assert "with the truth of 20 frames later" in line
    assert doubts(captured(true[50:180]), true) == []


def test_another_clip_is_named_where_joints_are_lacking() -> None:
    other = 0.5 * (motion(seed=20) + REST)
    true = 0.5 * (motion() + REST)
    lines = doubts(other, true, dataset="3dpw")
    assert any("change independently of each other" in line for line in lines)


def held(joints: Tensor) -> Tensor:
    found = joints.clone()
    found[90:170] = found[90]
    return found


def even(frames: int) -> Tensor:
    """Steady steps along x, 4 cm a frame, (F, 1, 3) m."""
    return 0.04 * torch.arange(frames)[:, None, None] * torch.tensor([1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "change",
    [
        captured,
        lambda true: captured(true, 0.06),
        lambda true: captured(held(true)),
        lambda true: captured(true) + smooth(FRAMES, 5, 25, (1, 3)) * torch.tensor([0, 0, 0.4]),
        lambda true: captured(true) + 0.1 * even(FRAMES),
        lambda true: captured(true) + torch.tensor([0.5, 0.0, 0.2]),
    ],
    ids=["right", "noise", "held", "depth", "drift", "aside"],
)
@pytest.mark.parametrize("dataset", ["file", "3dpw"])
@pytest.mark.parametrize("steps", [False, True])
def test_errors_of_a_capture_are_no_frames_far_away(
    change: Callable[[Tensor], Tensor], dataset: str, steps: bool
) -> None:
    """Even of a person who walks on evenly: half a metre aside is where they soon were."""
    true = motion()
    if steps:
        true = true - true.mean(1, keepdim=True) + even(FRAMES)
    lines = doubts(change(true), true, dataset=dataset)
    assert not any("a clip that was cut" in line or "reversed" in line for line in lines)
    assert not any("independently" in line for line in lines)


def test_whoever_stands_has_no_other_frames() -> None:
    true = REST + 0.01 * smooth(FRAMES, 3, 5)
    assert doubts(captured(true[40:120]), true, dataset="3dpw") == []
