"""Truths with frames that are missing, or joints that were not measured in space."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from perfcap.app.scores import joint_scores
from perfcap.app.truth import FILE_PROTOCOL, FoundJoints, Truth
from perfcap.app.truth_doubts import joint_doubts
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.datasets import DatasetSequence


def walk(frames: int) -> torch.Tensor:
    """Joints that swing, each in its own way, (F, 16, 3) m."""
    generator = torch.Generator().manual_seed(0)
    rest = torch.rand(16, 3, generator=generator).double() * torch.tensor([0.5, 1.7, 0.4])
    phase = 6 * torch.rand(16, 3, generator=generator).double()
    joints = rest + 0.1 * torch.sin(torch.arange(frames).double()[:, None, None] / 5 + phase)
    joints[:, LANDMARKS.index("neck"), 1] = 1.8
    feet = [LANDMARKS.index(f"{side}_{joint}") for side in "rl" for joint in ("ankle", "toe")]
    joints[:, feet] = rest[feet] * torch.tensor([1.0, 0.02, 1.0])  # they stand
    return joints


@pytest.mark.parametrize(
    "kept",
    [
        np.r_[0:20, 35:60],
        np.array([f for f in range(60) if f % 5]),
        np.arange(0, 60, 3),
    ],
    ids=["without a stretch", "without every fifth", "every third"],
)
def test_frames_beside_a_gap_are_no_neighbours(kept: np.ndarray) -> None:
    """As if the same frames were there and unknown."""
    true = walk(60)
    noise = torch.randn(true.shape, generator=torch.Generator().manual_seed(1)).double()
    found = FoundJoints(Path("motion.npz"), true + 0.004 * noise, np.arange(60), 30.0)
    unknown = torch.full_like(true, torch.nan)
    unknown[kept] = true[kept]
    whole, short = (
        joint_scores(
            found,
            Truth(
                DatasetSequence(
                    "3dpw", "walk", Path("t"), torch.as_tensor(numbers), 30.0, joints3d=joints
                ),
                FILE_PROTOCOL,
                strict=False,
            ),
        )
        for numbers, joints in ((np.arange(60), unknown), (kept, true[kept]))
    )
    assert short.keys() == whole.keys()
    # the last two are of all frames of the result that are given
    for name in short.keys() - {"frames_missing", "penetration_mm", "bone_length_std_mm"}:
        assert short[name] == pytest.approx(whole[name], rel=1e-9), name
    assert ("jitter_jerk_gt_m_s3" in short) is (len(kept) != 20)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda joints: joints * torch.tensor([1.0, 1.0, 0.0]), "lie in one plane"),
        (lambda joints: halfway(joints, "r_hip", "r_knee", "r_ankle"), "r_knee of the truth lies"),
        (lambda joints: joints, ""),
    ],
)
def test_truths_that_were_not_measured_in_space_are_named(
    change: Callable[[torch.Tensor], torch.Tensor], said: str
) -> None:
    found = FoundJoints(Path("motion.npz"), walk(60) + 0.004, np.arange(60), 30.0)
    sequence = DatasetSequence(
        "file", "t", Path("t"), torch.arange(60), 30.0, joints3d=change(walk(60))
    )
    lines = joint_doubts(found, Truth(sequence, FILE_PROTOCOL, strict=False))
    assert any(said in line for line in lines) if said else not lines


def halfway(joints: torch.Tensor, *names: str) -> torch.Tensor:
    first, middle, last = (LANDMARKS.index(name) for name in names)
    moved = joints.clone()
    moved[:, middle] = 0.5 * (joints[:, first] + joints[:, last])
    return moved
