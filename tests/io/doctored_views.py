"""Views of a person that agree, to be spoiled, and the one finding that is expected."""

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import (
    Finding,
)

FRAMES, VIEWS = 24, 4
NAMES = tuple(f"cam{view + 1}" for view in range(VIEWS))


def person() -> Tensor:
    """A walking, turning person (F, 16, 3), metres, y up, standing about the origin."""
    x = {"shoulder": 0.18, "elbow": 0.25, "wrist": 0.3, "hip": 0.1, "knee": 0.12, "ankle": 0.1}
    y = {"head_top": 1.7, "neck": 1.45, "shoulder": 1.4, "elbow": 1.15, "wrist": 0.95}
    y |= {"hip": 0.92, "knee": 0.5, "ankle": 0.08, "toe": 0.02}
    swing = {"elbow": 0.1, "wrist": 0.3, "knee": 0.15, "ankle": 0.25, "toe": 0.3}
    rest, sway = [], []
    for name in LANDMARKS:
        side, _, part = name.partition("_") if name[1] == "_" else ("", "", name)
        sign = {"r": -1.0, "l": 1.0, "": 0.0}[side]
        rest.append((sign * x.get(part, 0.11), y[part], 0.15 if part == "toe" else 0.0))
        sway.append((0.0, 0.0, sign * swing.get(part, 0.0)))
    time = torch.arange(FRAMES, dtype=torch.float64)[:, None, None] / 6
    pose = torch.tensor(rest).double() + torch.tensor(sway).double() * torch.sin(time)
    turn = rotvec_to_matrix(torch.cat((0 * time, 0.3 * time, 0 * time), -1)[:, 0])
    return pose @ turn.mT + torch.tensor([0.3, 0, 0.1]).double() * torch.cos(time)


def rig() -> CameraRig:
    """Four cameras around the person, 4 m away and 1 m high."""
    yaw = torch.tensor([0.0, 1.1, 2.5, 4.0], dtype=torch.float64)
    down = torch.diag(torch.tensor([1.0, -1.0, -1.0])).double()  # world y up to camera y down
    rotation = down @ rotvec_to_matrix(torch.stack((0 * yaw, yaw, 0 * yaw), -1))
    centre_offset = torch.tensor([0.0, 1.0, 4.0], dtype=torch.float64).expand(VIEWS, 3)
    k = torch.tensor([[1000.0, 0, 500], [0, 1000, 480], [0, 0, 1]], dtype=torch.float64)
    size = ((1000, 1000),) * VIEWS
    return CameraRig(NAMES, Camera(k.expand(VIEWS, 3, 3), rotation, centre_offset, None, size))


def detections(cameras: CameraRig | None = None, noise: float = 4.0) -> Detections:
    pixels = (cameras or rig()).cameras.project(person())
    generator = torch.Generator().manual_seed(0)
    jitter = noise * torch.randn(pixels.shape, generator=generator, dtype=pixels.dtype)
    return Detections.from_joints(pixels + jitter, torch.full(pixels.shape[:-1], 0.9).double())


def change_view(good: CameraRig, view: int, **change: Tensor) -> CameraRig:
    fields = {}
    for name, value in change.items():
        field = getattr(good.cameras, name).clone()
        field[view] = value
        fields[name] = field
    return replace(good, cameras=replace(good.cameras, **fields))


def with_joints(good: Detections, change: Any) -> Detections:
    joints = good.joints2d.clone()
    change(joints)
    return replace(good, joints2d=joints)


def one(findings: list[Finding]) -> Finding:
    assert len(findings) == 1, [str(finding) for finding in findings]
    return findings[0]
