"""Known joints, and how programs write them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch

from perfcap.detect import joint_set as sets
from perfcap.detect.joint_set import LANDMARKS, JointSet

FRAMES = 6


def person(joint_set: JointSet = sets.LANDMARKS16, shift: float = 0.0, scale: float = 1.0) -> Any:
    """A standing pose (J, 3): where a joint is follows from its name, so order cannot matter."""
    rows = {"shoulder": -2, "elbow": -1, "wrist": 0, "hip": 0.2, "knee": 1, "ankle": 2}
    rows |= {"toe": 2.2, "heel": 2.1, "head_top": -3, "neck": -2, "nose": -2.7, "eye": -2.8}
    points = []
    for joint in joint_set.joints:
        side = {"r": -0.5, "l": 0.5}.get(joint.split("_")[0], 0.0)
        row = next((y for name, y in rows.items() if name in joint), 0.2)
        points.append((300 + 60 * scale * side + shift, 200 + 40 * scale * row, 0.9))
    return np.array(points)


def moving(joint_set: JointSet, frames: int = FRAMES) -> np.ndarray:
    return np.stack([person(joint_set, 3.0 * f) for f in range(frames)])


def expected(joint_set: JointSet) -> tuple[torch.Tensor, torch.Tensor]:
    values = torch.from_numpy(moving(joint_set))
    return sets.map_to_landmarks(values[..., :2], values[..., 2], joint_set)


def write_npz(path: Path, **change: Any) -> Path:
    values = moving(sets.LANDMARKS16)
    arrays = {"joints2d": values[..., :2], "confidence2d": values[..., 2], **change}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def write_openpose(folder: Path, people: list[list[np.ndarray]], first: int = 0) -> Path:
    folder.mkdir(parents=True)
    for f, candidates in enumerate(people):
        data = {
            "version": 1.3,
            "people": [{"pose_keypoints_2d": p.reshape(-1).tolist()} for p in candidates],
        }
        (folder / f"take2_{first + f:012d}_keypoints.json").write_text(json.dumps(data))
    return folder


def pose3d_mm(frames: int = FRAMES) -> np.ndarray:
    flat = moving(sets.LANDMARKS16, frames)
    pose = np.concatenate((flat[..., :2] * 8, flat[..., 2:] * 0), -1)
    hips = [LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip")]
    return pose - pose[:, hips].mean(1, keepdims=True)


def write_json(path: Path, data: Any) -> Path:
    path.write_text(json.dumps(data))
    return path
