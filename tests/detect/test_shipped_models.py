"""Every network and prior under ``models`` opens, is small, and says what it is."""

import hashlib
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.lifter import OnnxLifter
from perfcap.detect.onnx import OnnxDetector
from perfcap.geometry.alignment import similarity_align
from perfcap.io.calibration import read_cameras
from perfcap.io.detections import read_detections
from perfcap.metrics.alignment import root_aligned

MODELS = Path(__file__).parents[2] / "models"
KINDS = ("lifters", "detectors", "priors")
LARGEST = {"blazepose_heavy": 28e6}  # bytes; of all others 20 MB
FOLDERS = sorted(p.parent for kind in KINDS for p in (MODELS / kind).glob("*/manifest.toml"))


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f"{f.parent.name}/{f.name}")
def test_files_are_as_the_manifest_says(folder: Path) -> None:
    entries = tomllib.loads((folder / "manifest.toml").read_text())["file"]
    for entry in entries:
        data = (folder / entry["name"]).read_bytes()
        assert len(data) == entry["size"] < LARGEST.get(folder.name, 20e6)
        assert hashlib.sha256(data).hexdigest() == entry["sha256"]
        assert b"site-packages" not in data
    assert (folder / "card.md").is_file()


@pytest.mark.long
def test_the_detector_follows_the_demo_clip() -> None:
    """Found in the first frame by search; the clip's actor is among those it learned from."""
    demo, count = MODELS / "demo", 120
    video = cv2.VideoCapture(str(demo / "video.mp4"))
    frames = [video.read()[1][..., ::-1] for _ in range(count)]
    found = OnnxDetector(MODELS / "detectors" / "rendered").follow(iter(frames))
    with np.load(demo / "truth.npz") as file:
        places = torch.tensor(file["joints3d"][:count]).double()
    truth = read_cameras(demo / "camera.json").cameras.project(places)[:, 0]
    torso = (truth[:, LANDMARKS.index("l_shoulder")] - truth[:, LANDMARKS.index("r_hip")]).norm(
        dim=-1
    )
    near = (found.joints2d[:, 0] - truth).norm(dim=-1) < 0.2 * torso[:, None]
    assert near.double().mean() > 0.8
    sure = found.confidence2d[:, 0] > 0.7
    assert near[sure].double().mean() > near[~sure].double().mean() + 0.1


def test_the_lifter_lifts_the_demo_clip() -> None:
    """Its motion, on other bones, is among what the lifter learned from; its detections, twice as
    bad as those, are not."""
    demo = MODELS / "demo"
    rig = read_cameras(demo / "camera.json")
    found, _ = read_detections(demo / "detections.npz", views=rig.names)
    lifter = OnnxLifter(MODELS / "lifters" / "cmu")
    joints, spread = lifter.lift(found, rig.cameras, 30.0)
    with np.load(demo / "truth.npz") as file:
        truth = rig.cameras.to_camera(torch.tensor(file["joints3d"]).double())[:, 0]
    moved = similarity_align(joints[:, 0], truth)
    assert (moved - truth).norm(dim=-1).mean() < 0.08
    steps = (joints[:, 0].diff(dim=0) - root_aligned(truth).diff(dim=0)).norm(dim=-1)
    frames = [lifter.lift(found.frames(slice(f, f + 1)), rig.cameras, 30.0)[0] for f in range(20)]
    alone = (torch.cat(frames)[:, 0].diff(dim=0) - root_aligned(truth)[:20].diff(dim=0)).norm(
        dim=-1
    )
    assert steps[:19].mean() < 0.7 * alone.mean()  # what came before and after calms it
    assert 0.03 < spread.mean() < 0.2
