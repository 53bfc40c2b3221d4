"""Joints of some frames that are those of others before, to the last digit."""

from dataclasses import replace

import torch
from doctored_views import FRAMES, detections, one, rig
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Severity, examine_detections
from perfcap.io.doctor.repeated import examine_repeated


def late(seen: Detections, start: int, by: int) -> Detections:
    """As where frames were put in at ``start``, of those before."""
    index = torch.arange(seen.frame_count)
    return seen.frames(torch.where(index < start, index, index - by))


def test_frames_that_were_put_in() -> None:
    """The first of them are there twice; those after are late, and nowhere else."""
    seen = detections()
    for start, by in ((12, 2), (12, 5), (16, 6)):
        some = late(seen, start, by)
        finding = one(examine_repeated("cam2", 1, some.joints2d[:, 1], some.confidence2d[:, 1]))
        last = start + by - 1
        assert f"frames {start}-{last} (of the capture" in finding.what
        assert f"are those of {by} frames before to the last digit" in finding.what
        assert finding.frames == tuple(range(start, start + by)) and finding.views == (1,)
        assert finding.severity is Severity.WARNING
        found = examine_detections(rig(), some)
        assert [each.subject for each in found] == list(rig().names)


def test_one_frame_that_looks_like_another_is_none() -> None:
    """On the same whole pixels, say; and frames that show nobody are alike."""
    seen = detections()
    joints, confidence = seen.joints2d[:, 0].clone(), seen.confidence2d[:, 0].clone()
    joints[15] = joints[4]
    assert examine_repeated("cam1", 0, joints, confidence) == []
    joints[18:22], confidence[18:22] = joints[4:8], 0
    confidence[4:8, 3:] = 0
    assert examine_repeated("cam1", 0, joints, confidence) == []
    assert len(joints) == FRAMES


def test_3d_poses_of_the_frame_before() -> None:
    """Of a lifter that ran on every third frame, say, beside 2D joints of all."""
    take = make_take(30)
    alone = CameraRig(("a",), take.cameras)
    assert examine_detections(alone, take.detections) == []
    assert take.detections.joints3d is not None
    held = take.detections.joints3d[torch.arange(30) // 3 * 3]
    finding = one(examine_detections(alone, replace(take.detections, joints3d=held)))
    assert finding.what.startswith("20 of 29 frames repeat the 3D joints of the frame before")


def test_joints_that_stay_where_they_were() -> None:
    """As where gaps of single joints were filled with the last place; a joint that stands on whole
    pixels is none.
    """
    seen = detections()
    joints, confidence = seen.joints2d[:, 0].clone(), seen.confidence2d[:, 0]
    assert examine_repeated("cam1", 0, joints, confidence) == []
    joints[6:12, 4] = joints[5, 4]
    finding = one(examine_repeated("cam1", 0, joints, confidence))
    assert "the frame before to the last digit: r_wrist (6) frames" in finding.what
    assert examine_repeated("cam1", 0, (joints / 4).round() * 4, confidence) == []
    confidence = confidence.clone()
    confidence[6:12, 4] = 0
    assert examine_repeated("cam1", 0, joints, confidence) == []


def test_joints_at_one_place() -> None:
    seen = detections()
    joints = seen.joints2d[:, 0].clone()
    joints[[3, 9], 5:14] = joints[[3, 9], :1]
    finding = one(examine_repeated("cam1", 0, joints, seen.confidence2d[:, 0]))
    assert finding.what.startswith("10 joints with confidence lie at one place")
    assert finding.frames == (3, 9) and finding.views == (0,)


def test_frames_that_were_put_in_among_3d_poses_alone() -> None:
    take = make_take(30)
    alone = CameraRig(("a",), take.cameras)
    poses = replace(take.detections, confidence2d=0 * take.detections.confidence2d)
    assert examine_detections(alone, poses, coverage=False) == []
    finding = one(examine_detections(alone, late(poses, 12, 5), coverage=False))
    assert "frames 12-16 (of the capture" in finding.what and finding.views == (0,)


def test_joints_that_were_filled_with_the_mean() -> None:
    """Of all frames, wherever they were not found; no frame repeats the one before."""
    seen = detections()
    joints, confidence = seen.joints2d[:, 0].clone(), seen.confidence2d[:, 0]
    joints[[2, 5, 9, 14, 15, 20], 4] = joints[:, 4].mean(0)
    joints[[1, 4, 8, 13, 17], 9] = joints[:, 9].mean(0)
    finding = one(examine_repeated("cam1", 0, joints, confidence))
    assert "again and again: r_wrist (6), r_knee (5) frames" in finding.what
    assert examine_repeated("cam1", 0, joints.round(), confidence) == []
    confidence = confidence.clone()
    confidence[[2, 5, 9, 14, 15, 20], 4] = 0
    confidence[[1, 4, 8, 13, 17], 9] = 0
    assert examine_repeated("cam1", 0, joints, confidence) == []
