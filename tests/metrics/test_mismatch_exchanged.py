"""Left and right joints of a truth exchanged for a while, and stretches without a cause."""

from __future__ import annotations

import pytest
import torch
from swaying_truth import swaying, told, trembling
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16

ORDER = LANDMARKS16.mirrored()
LEGS = ("hip", "knee", "ankle", "toe")


@pytest.fixture(scope="module")
def joints() -> Tensor:
    return swaying()


@pytest.fixture(scope="module")
def captured(joints: Tensor) -> Tensor:
    """Off by some centimetres."""
    return joints + 0.02 * trembling(joints) + 0.01


def exchanged(points: Tensor, names: tuple[str, ...], part: slice) -> Tensor:
    changed = points.clone()
    for name in names:
        left, right = (LANDMARKS.index(f"{side}_{name}") for side in "lr")
        changed[part, [left, right]] = points[part, [right, left]]
    return changed


@pytest.mark.parametrize(
    ("names", "which"),
    [
        (LEGS, "hip, knee, ankle and toe"),
        (("shoulder", "elbow", "wrist"), "shoulder, elbow and wrist"),
        (("knee", "ankle", "toe"), "knee, ankle and toe"),
        (("wrist",), "wrist"),
    ],
)
@pytest.mark.parametrize("part", [slice(0, 12), slice(20, 45), slice(48, 60)])
def test_some_joints_of_a_stretch(
    joints: Tensor, captured: Tensor, names: tuple[str, ...], which: str, part: slice
) -> None:
    (line,) = told(captured, exchanged(joints, names, part))
    where = f"in frames {100 + part.start} to {99 + part.stop} "
    assert line.startswith(f"{where}with left and right {which} of the truth exchanged ")
    assert "% of their error is left" in line


@pytest.mark.parametrize("names", [LEGS, ("wrist",)])
def test_those_of_the_result_are_no_mistake_of_the_truth(
    joints: Tensor, captured: Tensor, names: tuple[str, ...]
) -> None:
    assert told(exchanged(captured, names, slice(20, 45)), joints) == ()


@pytest.mark.parametrize("change", ["larger", "mirrored", "other"])
@pytest.mark.parametrize("part", [slice(0, 12), slice(25, 40), slice(48, 60)])
def test_a_stretch_without_a_cause(
    joints: Tensor, captured: Tensor, change: str, part: slice
) -> None:
    """No lag is said to explain it because right frames lie beyond its ends."""
    truth, middle = joints.clone(), joints[:, 8:9]
    truth[part] = {
        "larger": middle + 1.5 * (joints - middle),
        "mirrored": middle + (joints - middle) * torch.tensor([1.0, -1.0, 1.0]).to(joints),
        "other": joints[:, torch.randperm(16, generator=torch.Generator().manual_seed(3))],
    }[change][part]
    (line,) = told(captured, truth)
    assert line.startswith(f"frames {100 + part.start} to {99 + part.stop} are far off (")
    assert "the truth leaps there" in line and "later" not in line
    assert told(truth, joints) == ()  # of a result that leaps nothing of the kind is said
