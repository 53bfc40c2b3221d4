"""Parts of a clip that run backwards within it."""

from dataclasses import replace

import torch
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Severity, examine_detections
from perfcap.io.doctor.backwards import examine_backwards

TAKE = make_take(40, turns=0.5)
CAMERA = CameraRig(("a",), TAKE.cameras)


def backwards(seen: Detections, start: int, stop: int) -> Detections:
    frames = torch.arange(seen.frame_count)
    frames[start:stop] = frames[start:stop].flip(0)
    return seen.frames(frames)


def test_a_part_that_runs_backwards_is_named() -> None:
    flat = TAKE.detections.without_poses()
    lifted = replace(TAKE.detections, confidence2d=0 * TAKE.detections.confidence2d)
    for seen in (flat, lifted):
        assert examine_detections(CAMERA, seen, coverage=False) == []
        for start, stop in ((10, 22), (15, 32)):
            spoiled = backwards(seen, start, stop)
            found = examine_detections(CAMERA, spoiled, coverage=False)
            (finding,) = (each for each in found if "played backwards" in each.what)
            assert finding.severity is Severity.WARNING and finding.views == (0,)
            assert finding.frames == tuple(range(start, stop))


def test_leaps_of_other_kinds_are_none() -> None:
    """Two frames in which joints are elsewhere, at one place, of somebody who hardly moves."""
    seen = TAKE.detections
    joints, sure = seen.joints2d[:, 0].clone(), seen.confidence2d[:, 0]
    joints[:] = joints[:1] + 0.1 * torch.randn(
        joints.shape, generator=torch.Generator().manual_seed(0)
    )
    joints[[10, 30]] = joints[10] + 50
    assert examine_backwards("a", 0, joints, sure) == []
    joints = seen.joints2d[:, 0].clone()
    joints[10:30] += 40  # of somebody else
    assert examine_backwards("a", 0, joints, sure) == []


def test_legs_exchanged_twice_are_none() -> None:
    """Of who hardly moves: they leap there and back, as a part that was turned round does."""
    still = make_take(60, turns=0.0).detections.without_poses()
    noise = torch.randn(still.joints2d.shape, generator=torch.Generator().manual_seed(0))
    joints, sure = still.joints2d[:1] + 0.5 * noise, still.confidence2d.clone()
    sure[..., [LANDMARKS.index(f"{s}_wrist") for s in "lr"]] = 0  # hidden
    legs = [LANDMARKS.index(f"{s}_{j}") for s in "lr" for j in ("hip", "knee", "ankle", "toe")]
    for few in (slice(7, 9), slice(45, 48)):
        joints[few, :, legs] = joints[few, :, legs[4:] + legs[:4]]
    one = joints[:, 0], sure[:, 0]
    assert examine_backwards("a", 0, *one) != []
    assert examine_backwards("a", 0, *one, LANDMARKS16.mirrored()) == []
    spoiled = replace(still, joints2d=joints, confidence2d=sure)
    found = examine_detections(CAMERA, spoiled, coverage=False)
    assert not any("played backwards" in each.what for each in found)
