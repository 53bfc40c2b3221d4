"""Frames of the shipped clip, whose joints are known: what networks are tried on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.crop import Frame
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.io.actor import models_folder
from perfcap.io.calibration import read_cameras
from perfcap.io.video import VideoFile

_EVERY = 6  # frames of the clip


@dataclass(frozen=True)
class KnownFrame:
    """An image and the landmarks of the person in it.

    Attributes:
        image: (H, W, 3), RGB.
        joints2d: (16, 2), pixels.
        joints3d: (16, 3), metres about the middle of the hips, camera axes.
    """

    image: Frame
    joints2d: NDArray[np.float64]
    joints3d: NDArray[np.float64]


@cache
def known_frames() -> tuple[KnownFrame, ...]:
    """Every sixth frame of the clip."""
    folder = models_folder() / "demo"
    camera = read_cameras(folder / "camera.json").cameras
    with np.load(folder / "truth.npz") as data:
        names = [str(name) for name in data["joint_names"]]
        joints = torch.from_numpy(data["joints3d"])[:, [names.index(name) for name in LANDMARKS]]
    pixels = camera.project(joints)[:, 0].numpy()
    local = camera.to_camera(joints)[:, 0]
    poses = (local - mid_hip(local)[:, None]).numpy()
    video = VideoFile(folder / "video.mp4")
    return tuple(
        KnownFrame(np.asarray(video.read(n, n + 1)[0]), pixels[n], poses[n])
        for n in range(0, len(pixels), _EVERY)
    )
