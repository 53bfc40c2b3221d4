"""Which files of a project folder are what, and what is said where one is missing."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.project import open_project

SHARED = Path(__file__).parents[3] / "shared" / "data"


def touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


def pose2sim(folder: Path, *poses: str, views: int = 2) -> Path:
    """An empty project: videos counted beyond nine, so that their order shows."""
    for view in range(views):
        touch(folder / "videos" / f"cam{view + 9}.mp4")
        for pose in poses:
            touch(folder / pose / f"cam{view + 9}_json" / "000.json")
    touch(folder / "calibration" / "Calib.toml")
    touch(folder / "Config.toml")
    return folder


def freemocap(folder: Path, name: str = "mediapipe_2dData_numCams_numFrames_x.npy") -> Path:
    touch(folder / "synchronized_videos" / "Camera_000.mp4")
    touch(folder / "synchronized_videos" / "Camera_001.MP4")
    touch(folder / "synchronized_videos" / "timestamps" / "a.csv")
    touch(folder / "take_camera_calibration.toml")
    touch(folder / "output_data" / "raw_data" / name)
    return folder


def test_a_project_of_pose2sim(tmp_path: Path) -> None:
    folder = pose2sim(tmp_path / "p", "pose", views=3)
    touch(folder / "videos" / "notes.txt")
    touch(folder / "videos" / ".hidden.mp4")
    touch(folder / "pose" / "cam9_pose.mp4")
    found = open_project(folder)
    assert found is not None and found.program == "Pose2Sim"
    assert [path.name for path in found.videos] == ["cam9.mp4", "cam10.mp4", "cam11.mp4"]
    assert [path.name for path in found.detections] == ["cam9_json", "cam10_json", "cam11_json"]
    assert found.cameras == folder / "calibration" / "Calib.toml"
    assert found.sentence() == (
        f"{folder}: a project of Pose2Sim with 3 videos in videos, cameras in "
        "calibration/Calib.toml, and joints in pose"
    )


def test_joints_count_frames_as_the_videos_do(tmp_path: Path) -> None:
    """Association is preferred, unless it is of synchronized joints, which are shifted."""

    def chosen(*poses: str) -> tuple[str, str]:
        found = open_project(pose2sim(tmp_path / "-".join(poses), *poses))
        assert found is not None
        return found.detections[0].parent.name, " ".join(found.warnings)

    assert chosen("pose", "pose-associated") == ("pose-associated", "")
    name, told = chosen("pose", "pose-sync", "pose-associated")
    assert name == "pose" and "--sync auto" in told
    name, told = chosen("pose-sync", "pose-associated")
    assert name == "pose-associated" and "shifted" in told
    name, told = chosen("pose-sync")
    assert name == "pose-sync" and "shifted" in told


def test_trials_use_the_calibration_of_their_session(tmp_path: Path) -> None:
    trial = pose2sim(tmp_path / "session" / "participant" / "trial", "pose")
    shutil.move(trial / "calibration", tmp_path / "session" / "S00_Calibration")
    with pytest.raises(InputError, match="without calibration"):  # that folder may be anybody's
        open_project(trial)
    for level in (trial.parent, trial.parent.parent):
        touch(level / "Config.toml")
    found = open_project(trial)
    assert found is not None
    assert found.cameras == tmp_path / "session" / "S00_Calibration" / "Calib.toml"
    assert str(found.cameras) in found.sentence()


@pytest.mark.parametrize("name", ["mediapipe_2dData_numCams_x.npy", "mediapipe2dData_numCams.npy"])
def test_a_recording_of_freemocap(tmp_path: Path, name: str) -> None:
    folder = freemocap(tmp_path / "take", name)
    touch(folder / "output_data" / "raw_data" / "mediapipe_3dData_numFrames.npy")
    found = open_project(folder)
    assert found is not None and found.program == "FreeMoCap"
    assert len(found.videos) == 2 and found.detections[0].name == name
    assert "take_camera_calibration.toml" in found.sentence() and "raw_data" in found.sentence()


def test_other_folders_are_none(tmp_path: Path) -> None:
    touch(tmp_path / "images" / "0001.png")
    touch(tmp_path / "easymocap" / "videos" / "1.mp4")
    assert open_project(tmp_path / "images") is None
    assert open_project(tmp_path / "easymocap") is None
    assert open_project(touch(tmp_path / "video.mp4")) is None
    assert open_project(tmp_path / "nothing") is None


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    folder = pose2sim(tmp_path / "p", "pose")
    shutil.rmtree(folder / "calibration")
    with pytest.raises(
        InputError, match=r"p: is a project of Pose2Sim without calibration/\*.toml"
    ):
        open_project(folder)
    own = touch(tmp_path / "own.toml")
    given = open_project(folder, cameras=own)
    assert given is not None and given.cameras == own
    shutil.rmtree(folder / "pose" / "cam9_json")
    with pytest.raises(InputError, match=r"pose: holds joints of 1 views \(cam10_json\), .* 2 vid"):
        open_project(folder, cameras=own)
    without = open_project(folder, cameras=own, joints=False)
    assert without is not None and without.detections == ()
    for video in (folder / "videos").iterdir():
        video.unlink()
    with pytest.raises(InputError, match="videos: holds no videos"):
        open_project(folder, cameras=own)
    recording = freemocap(tmp_path / "take")
    touch(recording / "b_camera_calibration.toml")
    with pytest.raises(InputError, match=r"holds 2 calibrations .*b_camera_cal.*take_camera"):
        open_project(recording)
    for path in recording.glob("*.toml"):
        path.unlink()
    with pytest.raises(InputError, match=r"FreeMoCap without \*_camera_calibration.toml"):
        open_project(recording)


def test_a_project_without_joints(tmp_path: Path) -> None:
    found = open_project(pose2sim(tmp_path / "p"))
    assert found is not None and found.detections == ()
    assert "found in the videos" in found.sentence()


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the recordings in ../shared")
@pytest.mark.parametrize("name", ["pose2sim_balancing", "pose2sim_multi"])
def test_a_real_project(name: str, tmp_path: Path) -> None:
    source = SHARED / name
    with pytest.raises(InputError, match=r"holds 2 calibrations .*Calib_qualisys.*Calib_scene"):
        open_project(source)
    for mine, theirs in (("videos", "videos"), ("pose-associated", "pose2d_associated")):
        (tmp_path / mine).symlink_to(source / theirs)
    (tmp_path / "calibration").mkdir()
    shutil.copy(source / "calibration" / "Calib_scene.toml", tmp_path / "calibration")
    found = open_project(tmp_path)
    assert found is not None and len(found.videos) == len(found.detections) == 4
    assert np.unique([path.stem for path in found.videos]).tolist() == [
        path.name.removesuffix("_json") for path in found.detections
    ]
