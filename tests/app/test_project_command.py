"""Projects of Pose2Sim and FreeMoCap as the input of commands."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from project_files import SIZE, write_calibration, write_freemocap, write_pose2sim
from runs import Command
from takes import Take, detect, make_take, shrunk

from perfcap.io.calibration import read_cameras

MORE = ("--actor", "sam", "--until", "track_motion", "--no-overlay")


@pytest.fixture(scope="module")
def take() -> Take:
    """A man seen by two small views, 10 frames."""
    from perfcap import load_actor

    made = make_take(10, views=2, lifted=False, actor=load_actor("sam"))
    cameras = shrunk(made.cameras, SIZE)
    return replace(made, cameras=cameras, detections=detect(made.actor, cameras, made.truth, False))


def error(out: Path, take: Take) -> float:
    """Mean distance from the truth, mm."""
    with np.load(out / "motion.npz") as motion:
        joints = motion["joints3d"]
    true = take.actor.joints(take.truth).numpy()
    return float(1000 * np.linalg.norm(joints - true, axis=-1).mean())


@pytest.mark.long
def test_a_project_of_pose2sim_is_captured(take: Take, tmp_path: Path, perfcap: Command) -> None:
    project = write_pose2sim(tmp_path / "walk", take)
    outcome = perfcap(["capture", project, "--out", tmp_path / "out", *MORE])
    assert outcome.code in (0, 3)
    assert "a project of Pose2Sim with 2 videos in videos" in outcome.out
    assert error(tmp_path / "out", take) < 15
    asked = json.loads((tmp_path / "out" / "run.json").read_text())["request"]
    assert [Path(video).name for video in asked["videos"]] == ["cam01.mp4", "cam02.mp4"]
    # the same as with every file named
    files = ["--cameras", project / "calibration" / "Calib_scene.toml", "--detections"]
    files += [project / "pose" / "cam01_json", project / "pose" / "cam02_json"]
    videos = [project / "videos" / "cam01.mp4", project / "videos" / "cam02.mp4"]
    perfcap(["capture", *videos, *files, "--out", tmp_path / "named", *MORE])
    assert error(tmp_path / "named", take) == error(tmp_path / "out", take)


@pytest.mark.long
@pytest.mark.parametrize("old", [False, True])
def test_a_recording_of_freemocap_is_captured(
    take: Take, tmp_path: Path, perfcap: Command, old: bool
) -> None:
    project = write_freemocap(tmp_path / "walk", take, old)
    outcome = perfcap(["capture", project, "--out", tmp_path / "out", *MORE])
    assert outcome.code in (0, 3)
    assert "a project of FreeMoCap with 2 videos in synchronized_videos" in outcome.out
    assert error(tmp_path / "out", take) < 25
    assert perfcap(["report", tmp_path / "out"]).code == 0  # it finds the cameras again


@pytest.mark.long
def test_doctor_looks_at_a_project(take: Take, tmp_path: Path, perfcap: Command) -> None:
    project = write_pose2sim(tmp_path / "walk", take)
    outcome = perfcap(["doctor", project])
    assert "a project of Pose2Sim" in outcome.out and "0 errors" in outcome.out
    (project / "pose" / "cam02_json").rename(project / "away")
    assert "holds joints of 1 views" in perfcap(["doctor", project]).refused()
    assert "holds joints of 1 views" in perfcap(["capture", project]).refused()


def test_lengths_of_freemocap_are_millimetres(take: Take, tmp_path: Path) -> None:
    project = write_freemocap(tmp_path / "walk", take)
    path = project / "walk_camera_calibration.toml"
    rig = read_cameras(path)
    true = take.cameras.translation.reshape(-1, 3)
    np.testing.assert_allclose(rig.cameras.translation.reshape(-1, 3), true, atol=1e-9)
    assert any("millimetres" in line for line in rig.warnings)
    write_calibration(path, take, ("cam_0", "cam_1"))  # converted before
    rig = read_cameras(path)
    np.testing.assert_allclose(rig.cameras.translation.reshape(-1, 3), true, atol=1e-9)
    assert not any("millimetres" in line for line in rig.warnings)
    # elsewhere nobody knows whose it is
    write_calibration(tmp_path / "Calib.toml", take, ("cam_0", "cam_1"), 1000.0)
    rig = read_cameras(tmp_path / "Calib.toml")
    np.testing.assert_allclose(rig.cameras.translation.reshape(-1, 3), 1000 * true, atol=1e-6)
