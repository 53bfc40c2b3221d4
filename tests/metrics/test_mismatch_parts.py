"""Truths that are wrong in their last third, or call joints by each other's names, are told."""

from __future__ import annotations

import pytest
import torch
from swaying_truth import swaying, told, trembling
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.metrics import mismatches

ORDER = LANDMARKS16.mirrored()
FROM = 40  # of 60 frames


@pytest.fixture(scope="module")
def joints() -> Tensor:
    return swaying()


@pytest.fixture(scope="module")
def captured(joints: Tensor) -> Tensor:
    """With an error that drifts and trembles."""
    drift = torch.linspace(0, 0.08, 60).to(joints)[:, None, None]
    return joints + 0.01 * trembling(joints) + drift


def test_errors_of_a_capture_are_not_explained(joints: Tensor, captured: Tensor) -> None:
    assert told(captured, joints) == ()
    astray = captured.clone()  # the result leaves, not the truth
    astray[FROM:] += 0.3
    assert told(astray, joints) == ()
    turned = captured.clone()
    turned[FROM:] = captured[FROM:, list(ORDER)]
    assert told(turned, joints) == ()


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        ("held", "the truth stands still in frames 140 to 159"),
        ("jump", "in frames 140 to 159 after one shift of 0."),
        ("axes", "in frames 140 to 159 after one rotation by 90 degrees"),
        ("sides", "in frames 140 to 159 with left and right of the truth exchanged"),
        ("units", "in frames 140 to 159 the person of the truth is "),
    ],
)
def test_a_truth_that_is_wrong_from_some_frame_on(
    joints: Tensor, captured: Tensor, mistake: str, words: str
) -> None:
    truth = joints.clone()
    turn = rotvec_to_matrix(torch.tensor([torch.pi / 2, 0, 0]).to(joints))
    truth[FROM:] = {
        "held": joints[FROM].expand_as(joints[FROM:]),
        "jump": joints[FROM:] + torch.tensor([0.3, 0.0, 0.0]).to(joints),
        "axes": joints[FROM:] @ turn.mT,
        "sides": joints[FROM:, list(ORDER)],
        "units": 1000 * joints[FROM:],
    }[mistake]
    (line,) = told(captured, truth)
    assert words in line


def test_frames_that_are_lost(joints: Tensor) -> None:
    """A file that lacks six frames of the video and ends with others."""
    later = (torch.arange(54) + torch.where(torch.arange(54) < 36, 0, 6)).tolist()
    everything = torch.ones(54, 16, dtype=torch.bool)
    (line,) = mismatches(joints[:54], joints[later], everything, ORDER)  # counts from 0
    assert "with the truth of 6 frames earlier" in line and "numbers of its frames" in line


def test_joints_that_are_exchanged_in_all_frames(joints: Tensor, captured: Tensor) -> None:
    order = list(range(16))
    for side in "lr":
        knee, ankle = (LANDMARKS.index(f"{side}_{name}") for name in ("knee", "ankle"))
        order[knee], order[ankle] = ankle, knee
    (line,) = told(captured, joints[:, order])
    assert "r_knee looks like r_ankle" in line and "order of the landmarks" in line
