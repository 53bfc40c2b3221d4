"""Cameras that move and are calibrated as if they stood still."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from doctored_views import one
from numpy.typing import NDArray

from perfcap.detect.detections import Detections
from perfcap.io.calibration import CameraRig, match_image, read_cameras
from perfcap.io.clip import Clip
from perfcap.io.detections import read_detections
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.inputs import examine_take
from perfcap.io.doctor.rest import examine_rest

DEMO = Path(__file__).parents[2] / "models" / "demo"
FRAMES, SIDE = 60, 240


class Panned:
    """A wall with spots, and a bright person before it, through a camera that turns."""

    name, lost, warnings, fps, timestamps = "panned", 0, (), 30.0, None

    def __init__(self, shift: float, walk: float = 1.0) -> None:
        self.shift, self.walk = shift, walk
        self.size, self.total = (SIDE, SIDE), FRAMES
        spots = np.random.default_rng(0).integers(0, 255, (100, 150), dtype=np.uint8)
        self.wall = cv2.resize(spots, (3 * SIDE, 2 * SIDE), interpolation=cv2.INTER_CUBIC)

    def __len__(self) -> int:
        return FRAMES

    def joints(self) -> NDArray[np.float64]:
        """(F, 1, 16, 2)."""
        body = np.stack((np.tile((100.0, 120.0), 8), np.linspace(60, 180, 16)), -1)
        return np.stack([[body + np.array((self.walk * frame, 0))] for frame in range(FRAMES)])

    def read(self, start: int, stop: int) -> NDArray[np.uint8]:
        images = []
        for frame, joints in enumerate(self.joints()[start:stop, 0], start):
            left = SIDE / 2 + self.shift * frame
            middle = (left + SIDE / 2 - 0.5, SIDE - 0.5)
            image = cv2.getRectSubPix(self.wall, (SIDE, SIDE), middle)
            (x0, y0), (x1, y1) = joints.min(0).astype(int), joints.max(0).astype(int)
            image[y0:y1, x0:x1] = 250
            images.append(image)
        return np.stack(images)[..., None].repeat(3, -1)

    def close(self) -> None: ...


def looked_at(source: Panned, confidence: float = 1.0) -> list[Finding]:
    joints = source.joints()
    certain = np.full(joints.shape[:-1], confidence)
    return examine_rest(Clip([source], 30.0), ["left"], 30.0, joints, certain)


@pytest.mark.parametrize("shift", [0.2, 1.0, -1.5])
def test_a_camera_that_turns_is_named(shift: float) -> None:
    found = one(looked_at(Panned(shift)))
    assert found.severity is Severity.WARNING and found.subject == "left"
    percent = float(found.what.split("shifts by ")[1].split("%")[0])
    assert abs(percent - 1500 * abs(shift) / SIDE) < 0.3 and "tripod" in found.remedy


def test_a_camera_at_rest_and_a_person_who_walks() -> None:
    assert looked_at(Panned(0.0)) == looked_at(Panned(0.0, walk=-0.5)) == []


def test_where_nothing_shows_it() -> None:
    """No person is known, a plain wall, a single frame."""
    assert looked_at(Panned(1.0), confidence=0.0) == []
    plain = Panned(1.0)
    plain.wall[:] = 60
    assert looked_at(plain) == []
    source = Panned(1.0)
    seen = source.joints()[:1]
    assert examine_rest(Clip([source], 30.0), ["a"], 30.0, seen, np.ones(seen.shape[:-1])) == []


def test_it_is_looked_at_where_joints_were_found_in_the_video() -> None:
    """And what supposes a camera at rest is not said of one that moves."""
    source = Panned(1.5, walk=0.0)
    clip = Clip([source], 30.0)
    joints = torch.from_numpy(source.joints())
    certain = torch.ones(joints.shape[:-1], dtype=torch.float64)
    seen = Detections(joints, certain, None, torch.zeros(joints.shape[:-2], dtype=torch.bool))
    known = read_cameras(DEMO / "camera.json")
    rig = CameraRig(known.names, known.cameras.map(lambda part: part.double()))
    pixels = match_image(known, ((720, 720),), None)
    for detected in (True, False):
        found = [
            each
            for each in examine_take(rig, seen, clip, pixels, detected)
            if "camera moves" in each.what or "lie on what moves" in each.what
        ]
        assert one(found).subject == rig.names[0] and "stand still" in found[0].what


def test_the_demo_stands_still() -> None:
    clip = Clip.open(DEMO / "video.mp4")
    seen, _ = read_detections([DEMO / "detections.npz"], views=("camera",))
    joints, certain = (part.double().numpy() for part in (seen.joints2d, seen.confidence2d))
    assert examine_rest(clip, clip.names, clip.fps, joints, certain) == []
