"""A lens that was guessed: poses depend on it little."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from perfcap.io.actor import load_actor, models_folder
from perfcap.io.calibration import read_cameras
from perfcap.io.detections import read_detections
from perfcap.metrics import joint_errors
from perfcap.pipeline.jobs import capture

DEMO, FRAMES, RATE = models_folder() / "demo", slice(20, 50), 30.0


@pytest.mark.long
@pytest.mark.parametrize("factor", [0.6, 1.7])
def test_a_wrong_focal_length_costs_little(factor: float) -> None:
    """The shipped clip with its detections: 3 mm of PA-MPJPE at most, distances follow the lens."""
    rig = read_cameras(DEMO / "camera.json")
    found, _ = read_detections(DEMO / "detections.npz", views=rig.names)
    found = found.frames(FRAMES).to(torch.zeros((), dtype=torch.float64))
    with np.load(DEMO / "truth.npz") as file:
        truth = torch.tensor(file["joints3d"][FRAMES]).double()
    actor, errors, depths = load_actor("sam"), [], []
    for scale in (1.0, factor):
        intrinsics = rig.cameras.intrinsics.clone()
        intrinsics[..., 0, 0] *= scale
        intrinsics[..., 1, 1] *= scale
        cameras = replace(rig.cameras, intrinsics=intrinsics)
        joints = capture(actor, cameras, found, RATE).joints().double()
        errors.append(float(joint_errors(joints, truth, RATE).mpjpe_similarity))
        depths.append(float(cameras.to_camera(joints)[..., 2].mean()))
    assert errors[1] < errors[0] + 3.0
    assert depths[1] / depths[0] == pytest.approx(factor, rel=0.1)
