"""A take in the folders of other programs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from takes import Take, write_json, write_video

from perfcap.detect.joint_set import BLAZEPOSE33, BODY_25, LANDMARKS

SIZE = (120, 160)
NAMES = ("cam01", "cam02")
_TOES = {
    "l_big_toe": "l_toe",
    "r_big_toe": "r_toe",
    "l_foot_index": "l_toe",
    "r_foot_index": "r_toe",
}


def write_calibration(path: Path, take: Take, names: tuple[str, ...], unit: float = 1.0) -> None:
    """A TOML with a section a camera; ``unit`` is how many of its lengths are a metre."""
    text = "[metadata]\nadjusted = false\n"
    cameras = take.cameras
    for view, name in enumerate(names):
        one = cameras.select([view])
        vector = cv2.Rodrigues(one.rotation.reshape(3, 3).numpy())[0].ravel().tolist()
        shift = (unit * one.translation.reshape(3)).tolist()
        text += f'[{name}]\nname = "{name}"\nsize = [{SIZE[1]}.0, {SIZE[0]}.0]\n'
        text += f"matrix = {one.intrinsics.reshape(3, 3).tolist()}\n"
        text += f"distortions = [0.0, 0.0, 0.0, 0.0]\nrotation = {vector}\ntranslation = {shift}\n"
        text += "fisheye = false\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def write_pose2sim(folder: Path, take: Take, poses: tuple[str, ...] = ("pose",)) -> Path:
    """Videos, calibration and OpenPose JSON, as Pose2Sim has them."""
    _write_videos(folder / "videos", take, NAMES)
    write_calibration(folder / "calibration" / "Calib_scene.toml", take, NAMES)
    (folder / "Config.toml").write_text("[project]\n")
    for pose in poses:
        for view, name in enumerate(NAMES):
            write_json_folder(folder / pose / f"{name}_json", take, view)
    return folder


def write_json_folder(folder: Path, take: Take, view: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for frame, joints in enumerate(_named(take, view, BODY_25.joints)):
        joints[8] = (joints[9] + joints[12]) / 2  # the middle of the hips tells the set
        people = [{"pose_keypoints_2d": joints.ravel().tolist()}]
        write_json(folder / f"{folder.name}_{frame:06d}.json", {"people": people})


def write_freemocap(folder: Path, take: Take, old: bool = False) -> Path:
    """A recording: videos, a calibration in millimetres, MediaPipe's points of all views."""
    _write_videos(folder / "synchronized_videos", take, ("Camera_000", "Camera_001"))
    name = folder / f"{folder.name}_camera_calibration.toml"
    write_calibration(name, take, ("cam_0", "cam_1"), 1000.0)
    raw = folder / "output_data" / "raw_data"
    raw.mkdir(parents=True)
    views = [_named(take, view, BLAZEPOSE33.joints)[..., :2] for view in range(len(NAMES))]
    points = np.where(np.array(views) == 0, np.nan, np.array(views))
    rest = np.full((*points.shape[:2], 553 - 33, 2), np.nan)
    file = "mediapipe2dData" if old else "mediapipe_2dData"
    np.save(
        raw / f"{file}_numCams_numFrames_numTrackedPoints_pixelXY.npy",
        np.concatenate([points, rest], 2),
    )
    return folder


def _write_videos(folder: Path, take: Take, names: tuple[str, ...]) -> None:
    folder.mkdir(parents=True)
    seen = take.detections.joints2d
    for view, name in enumerate(names):
        write_video(folder / f"{name}.mp4", len(seen), SIZE, take.rate, seen=seen[:, view])


def _named(take: Take, view: int, names: tuple[str, ...]) -> np.ndarray:
    """Joints of that order, (F, J, 3): pixels and confidence; zeros for those a take lacks."""
    seen = take.detections.joints2d[:, view].numpy()
    found = np.zeros((len(seen), len(names), 3))
    for index, joint in enumerate(_TOES.get(name, name) for name in names):
        if joint in LANDMARKS:
            found[:, index, :2], found[:, index, 2] = seen[:, LANDMARKS.index(joint)], 0.9
    return found
