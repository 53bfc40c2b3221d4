"""Truths that repeat poses, or whose joints stay at one place; those of people do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io import models_folder
from perfcap.metrics import mismatches

ANKLES = [LANDMARKS.index(f"{side}_ankle") for side in "lr"]


@pytest.fixture(scope="module")
def joints() -> Tensor:
    take = make_take(60, turns=0.2)
    places: Tensor = take.actor.joints(take.truth)
    return places


def told(truth: Tensor, joints: Tensor) -> str:
    """Of a result with errors of a few millimetres."""
    noise = torch.randn(joints.shape, generator=torch.Generator().manual_seed(0)).to(joints)
    everything = torch.ones(truth.shape[:-1], dtype=torch.bool)
    order = LANDMARKS16.mirrored()
    found = mismatches(joints + 0.005 * noise, truth, everything, order, joints=LANDMARKS)
    return "; ".join(found)


@pytest.mark.parametrize("times", [2, 3, 4])
def test_poses_that_are_held_for_a_few_frames(joints: Tensor, times: int) -> None:
    truth = joints[::times].repeat_interleave(times, 0)
    assert "recorded at a lower rate" in told(truth, joints)


@pytest.mark.parametrize("fill", ["last", "mean"])
def test_gaps_of_one_joint_that_were_filled(joints: Tensor, fill: str) -> None:
    truth, wrist = joints.clone(), LANDMARKS.index("l_wrist")
    truth[20:32, wrist] = truth[20, wrist] if fill == "last" else truth[:, wrist].mean(0)
    assert "l_wrist in 12 frames at one place" in told(truth, joints)
    assert not told(joints, joints)


def test_a_foot_that_stands_is_not_filled(joints: Tensor) -> None:
    truth = joints.clone()
    truth[20:50, ANKLES] = truth[20, ANKLES]
    assert "at one place" not in told(truth, truth)


def test_a_person_who_stops_now_and_then_repeats_nothing(joints: Tensor) -> None:
    still = torch.arange(60)
    still[10:25], still[40:50] = 10, 40
    assert "lower rate" not in told(joints[still], joints[still])


def test_truths_of_people_repeat_nothing() -> None:
    data = Path(__file__).resolve().parents[3] / "shared" / "data"
    for path in (models_folder() / "demo/truth.npz", *sorted(data.glob("rendered*/**/gt.npz"))):
        with np.load(path) as arrays:
            truth = torch.from_numpy(arrays["joints3d"]).double()
        found = told(truth, truth)
        assert "lower rate" not in found and "at one place" not in found, path
