"""One joint of both sides that is exchanged in a part of the frames, in every view."""

from __future__ import annotations

from dataclasses import replace

import pytest
from takes import make_take
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import examine_agreement, examine_detections

COUNT = 60
PART = slice(20, 40)


def spoiled(seen: Detections, name: str, part: slice) -> Detections:
    order = list(range(len(LANDMARKS)))
    left, right = (LANDMARKS.index(f"{side}_{name}") for side in "lr")
    order[left], order[right] = right, left

    def changed(values: Tensor) -> Tensor:
        values = values.clone()
        values[part] = values[part][:, :, order]
        return values

    poses = seen.joints3d
    return replace(
        seen,
        joints2d=changed(seen.joints2d),
        confidence2d=changed(seen.confidence2d),
        joints3d=None if poses is None else changed(poses),
    )


@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("name", ["elbow", "wrist", "ankle"])
def test_a_part_is_named_with_its_frames(name: str, views: int) -> None:
    take = make_take(COUNT, views=views)
    rig = CameraRig(tuple("abc"[:views]), take.cameras)
    flat = take.detections if views == 1 else take.detections.without_poses()
    said = examine_detections if views == 1 else examine_agreement
    assert said(rig, flat) == []
    (found,) = said(rig, spoiled(flat, name, PART))
    assert f"l_{name} and r_{name} look exchanged in frames" in found.what
    frames, wrong = set(found.frames), set(range(COUNT)[PART])
    assert len(frames & wrong) >= 16 and len(frames - wrong) <= 2
    assert found.views == tuple(range(views))


def test_a_few_frames_are_not() -> None:
    take = make_take(COUNT, views=3)
    rig = CameraRig(("a", "b", "c"), take.cameras)
    flat = take.detections.without_poses()
    assert examine_agreement(rig, spoiled(flat, "wrist", slice(20, 25))) == []
