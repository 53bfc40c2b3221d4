"""The demo clip is what it says: unaltered files, and truth that its own actor reproduces."""

import hashlib
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.actor import load_actor, models_folder
from perfcap.io.calibration.camera_json import read_camera_json

DEMO = models_folder() / "demo"
FRAMES, SIZE, RATE = 120, (720, 720), 30.0
MEBIBYTE = 2**20

Arrays = dict[str, np.ndarray]


def load(path: Path) -> Arrays:
    with np.load(path, allow_pickle=False) as data:
        return {name: data[name] for name in data.files}


@pytest.fixture(scope="module")
def truth() -> Arrays:
    return load(DEMO / "truth.npz")


@pytest.fixture(scope="module")
def detections() -> Arrays:
    return load(DEMO / "detections.npz")


@pytest.fixture(scope="module")
def actor() -> Iterator[Actor]:
    yield load_actor("sam")


@pytest.fixture(scope="module")
def camera() -> Camera:
    return read_camera_json(DEMO / "camera.json").cameras


def motion_of(truth: Arrays) -> Motion:
    names = ("root_translation", "root_rotation", "angles")
    translation, rotation, angles = (torch.tensor(truth[name]) for name in names)
    return Motion(translation, rotation, angles)


def pixels_of(truth: Arrays, camera: Camera) -> np.ndarray:
    return camera.project(torch.tensor(truth["joints3d"]))[:, 0].numpy()


def test_files_are_those_of_the_manifest() -> None:
    manifest = tomllib.loads((DEMO / "manifest.toml").read_text())["file"]
    assert {entry["name"] for entry in manifest} == {
        path.name for path in DEMO.iterdir() if path.suffix not in (".md", ".toml")
    }
    for entry in manifest:
        data = (DEMO / entry["name"]).read_bytes()
        assert len(data) == entry["size"]
        assert hashlib.sha256(data).hexdigest() == entry["sha256"]
    assert sum(entry["size"] for entry in manifest) < 4 * MEBIBYTE


def test_truth_is_the_actor_at_its_angles(truth: Arrays, actor: Actor) -> None:
    joints = actor.joints(motion_of(truth))
    np.testing.assert_allclose(truth["joints3d"], joints.numpy(), atol=1e-6)
    assert tuple(truth["joint_names"]) == LANDMARKS
    assert tuple(truth["angle_names"]) == actor.skeleton.angle_names


def test_truth_is_within_the_limits(truth: Arrays, actor: Actor) -> None:
    lower, upper = actor.skeleton.lower.numpy(), actor.skeleton.upper.numpy()
    np.testing.assert_allclose(truth["angle_lower"], lower, atol=1e-9)
    np.testing.assert_allclose(truth["angle_upper"], upper, atol=1e-9)
    assert (truth["angles"] >= lower).all()
    assert (truth["angles"] <= upper).all()


def test_dancer_stands_on_the_floor(truth: Arrays, actor: Actor) -> None:
    with torch.no_grad():
        surface = actor.surface(motion_of(truth)[::10])
    assert surface[..., 1].amin(-1).abs().max() < 0.03


def test_dancer_is_in_view(truth: Arrays, camera: Camera) -> None:
    assert camera.size == (SIZE,)
    pixels = pixels_of(truth, camera)
    assert pixels.min() > 0
    assert pixels.max() < min(SIZE) - 1


def test_arrays_have_a_row_for_every_frame(truth: Arrays, detections: Arrays) -> None:
    assert float(truth["fps"]) == RATE
    assert (truth["frames"] == np.arange(FRAMES)).all()
    assert tuple(detections["joint_names"]) == LANDMARKS
    for name in ("joints2d", "confidence2d", "joints3d_mm"):
        assert detections[name].shape[:2] == (FRAMES, len(LANDMARKS))
        assert np.isfinite(detections[name]).all()


def test_detections_are_right_on_the_whole_but_not_everywhere(
    truth: Arrays, detections: Arrays, camera: Camera
) -> None:
    pixels = pixels_of(truth, camera)
    error = np.linalg.norm(detections["joints2d"] - pixels, axis=-1)
    assert 2 < np.median(error) < 8
    assert (error > 60).sum() > 20  # swaps and outliers are what the solver must survive
    ankles = [LANDMARKS.index(name) for name in ("r_ankle", "l_ankle")]
    crossed = np.linalg.norm(
        detections["joints2d"][:, ankles] - pixels[:, ankles[::-1]], axis=-1
    ).sum(-1)
    assert (crossed < 0.3 * error[:, ankles].sum(-1)).any()


def test_3d_detections_are_relative_to_the_hips_in_camera_axes(
    truth: Arrays, detections: Arrays, camera: Camera
) -> None:
    local = camera.to_camera(torch.tensor(truth["joints3d"]))[:, 0].numpy()
    hips = [LANDMARKS.index(name) for name in ("r_hip", "l_hip")]
    relative = local - local[:, hips].mean(1, keepdims=True)
    error = np.linalg.norm(detections["joints3d_mm"] / 1000 - relative, axis=-1)
    assert np.median(error) < 0.15
    assert error.max() > 0.4  # flipped limbs and wrong poses


def test_video_has_the_frames_and_the_size() -> None:
    clip = pytest.importorskip("perfcap.io.clip").Clip.open(DEMO / "video.mp4")
    assert (len(clip), clip.sizes, clip.fps) == (FRAMES, (SIZE,), RATE)
    clip.close()
