"""Parts of a clip that run backwards within it."""

from dataclasses import replace

import torch
from takes import make_take

from perfcap.detect.detections import Detections
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
