"""The shipped lifter where it was not made for: cameras on their side, few frames a second."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.lifter import OnnxLifter
from perfcap.errors import InputError
from perfcap.geometry.alignment import similarity_align
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import read_cameras
from perfcap.io.detections import read_detections

MODELS = Path(__file__).parents[2] / "models"


def _demo() -> tuple[OnnxLifter, Camera, Detections, Tensor]:
    """The lifter, the demo's camera and detections, and its truth in camera axes."""
    demo = MODELS / "demo"
    rig = read_cameras(demo / "camera.json")
    found, _ = read_detections(demo / "detections.npz", views=rig.names)
    with np.load(demo / "truth.npz") as file:
        truth = rig.cameras.to_camera(torch.tensor(file["joints3d"]).double())[:, 0]
    return OnnxLifter(MODELS / "lifters" / "cmu"), rig.cameras, found, truth


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_camera_on_its_side_is_told_from_somebody_who_lies(quarters: int) -> None:
    lifter, camera, found, _ = _demo()
    straight, doubt = lifter.lift(found, camera, 30.0)
    angle = 0.5 * math.pi * quarters
    turn = torch.tensor(
        [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    ).double()
    middle, focal = camera.intrinsics[..., :2, 2], camera.intrinsics[0, 0, 0]
    pixels = focal * (camera.to_plane(found.joints2d) @ turn.mT) + middle
    turned, other = lifter.lift(replace(found, joints2d=pixels), camera, 30.0)
    back = torch.cat((turned[..., :2] @ turn, turned[..., 2:]), -1)
    torch.testing.assert_close(back, straight, atol=2e-3, rtol=0)
    torch.testing.assert_close(other, doubt, atol=2e-3, rtol=0)


@pytest.mark.parametrize(("share", "turned"), [(0.9, False), (0.5, True)])
def test_a_turned_view_is_believed_where_errors_are_much_smaller(
    share: float, turned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    lifter, camera, found, _ = _demo()
    middle, focal = camera.intrinsics[..., :2, 2], camera.intrinsics[0, 0, 0]
    lying = camera.to_plane(found.joints2d) @ torch.tensor([[0.0, 1.0], [-1.0, 0.0]]).double()
    found = replace(found, joints2d=focal * lying + middle)
    calls: list[float] = []

    def answer(plane: Tensor, confidence: Tensor) -> tuple[Tensor, Tensor]:
        calls.append(share if calls else 1.0)  # as it is, then turned
        joints = torch.tensor([1.0, 2.0, 3.0]).expand(*plane.shape[:-1], 3).clone()
        return joints, torch.full(plane.shape[:-1], calls[-1])

    monkeypatch.setattr(lifter, "lift_tracks", answer)
    joints, spread = lifter.lift(found, camera, 30.0)
    assert len(calls) == 2
    assert torch.all(spread == (torch.tensor(share).double() if turned else 1.0))
    assert (joints[0, 0, 0].tolist() == [1, 2, 3]) is not turned
    assert sorted(joints[0, 0, 0].abs().tolist()) == [1, 2, 3]  # turned back by a quarter


@pytest.mark.parametrize("step", [2, 3, 5])
def test_slow_cameras_are_lifted_nearly_as_well(step: int) -> None:
    lifter, camera, found, truth = _demo()

    def error(every: int) -> float:
        part = found.frames(slice(None, None, every))
        joints, _ = lifter.lift(part, camera, 30.0 / every)
        moved = similarity_align(joints[:, 0], truth[::every])
        return float((moved - truth[::every]).norm(dim=-1).mean())

    assert error(step) < 1.1 * error(1)


@pytest.mark.parametrize("rate", [0.0, -25.0, math.nan, math.inf])
def test_a_rate_that_is_none(rate: float) -> None:
    lifter, camera, found, _ = _demo()
    with pytest.raises(InputError, match="expected frames a second"):
        lifter.lift(found, camera, rate)
