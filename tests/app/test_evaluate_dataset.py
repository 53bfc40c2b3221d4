"""``perfcap evaluate --dataset``: joints that were not measured, and other rates."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from runs import Command

from perfcap.io.datasets.joint_sets import H36M32
from perfcap.io.datasets.layout import landmarks_of

FRAMES = 40


def write(folder: Path, zero: slice = slice(0), joint: str = "l_wrist") -> np.ndarray:
    """A sequence of Human3.6M with a joint at 0, 0, 0 in some frames, and its landmarks."""
    points = np.random.default_rng(0).normal(0, 0.4, (1, 32, 3)) + np.ones((FRAMES, 1, 3))
    points += 0.01 * np.arange(FRAMES)[:, None, None]
    true = np.nan_to_num(landmarks_of(points, H36M32).numpy())
    points[zero, H36M32.joints.index(joint)] = 0
    packed = np.array({"S9": {"Walking": points}}, dtype=object)
    np.savez(folder / "data_3d_h36m.npz", positions_3d=packed)
    return true


def scored(folder: Path, true: np.ndarray, perfcap: Command, fps: float = 50.0) -> dict[str, Any]:
    """Numbers of a result that is 10 mm off everywhere."""
    result = folder / "result"
    result.mkdir()
    joints = true + np.array([0.01, 0, 0])
    np.savez(result / "motion.npz", joints3d=joints, frames=np.arange(FRAMES), fps=fps)
    arguments = ["evaluate", result, "--truth", folder, "--dataset", "human36m"]
    outcome = perfcap([*arguments, "--sequence", "S9/Walking"])
    assert outcome.code == 0
    values = json.loads((result / "metrics.json").read_text())
    assert isinstance(values, dict)
    return values


@pytest.mark.parametrize("frames", [slice(0, FRAMES), slice(10, 14)], ids=["all", "some"])
def test_joints_at_zero_are_left_out_and_named(
    tmp_path: Path, perfcap: Command, frames: slice
) -> None:
    values = scored(tmp_path, write(tmp_path, frames), perfcap)
    notes = [note for note in values["notes"] if "as if not measured" in note]
    assert values["mpjpe_mm"] == pytest.approx(10) and values["joints_missing"] > 0
    count = len(range(FRAMES)[frames])
    assert len(notes) == 1 and f"l_wrist at 0, 0, 0 in {count} of 40 frames (first" in notes[0]


@pytest.mark.parametrize("fps", [50.0, 30.0])
def test_another_rate_than_the_data_sets(tmp_path: Path, perfcap: Command, fps: float) -> None:
    notes = scored(tmp_path, write(tmp_path), perfcap, fps)["notes"]
    found = [note for note in notes if "runs at 50 frames a second" in note]
    assert len(found) == (fps != 50.0) and not any("not measured" in note for note in notes)
