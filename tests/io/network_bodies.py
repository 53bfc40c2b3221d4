"""Known people as networks that predict bodies write them."""

from __future__ import annotations

from typing import Any

import numpy as np

from perfcap.detect.joint_set import LANDMARKS

FRAMES = 6
K = np.array([[900.0, 0, 320], [0, 900, 180], [0, 0, 1]])
RNG = np.random.default_rng(3)
SMPL = (
    *("pelvis", "l_hip", "r_hip", "spine1", "l_knee", "r_knee", "spine2", "l_ankle", "r_ankle"),
    *("spine3", "l_toe", "r_toe", "neck", "l_collar", "r_collar", "head"),
    *("l_shoulder", "r_shoulder", "l_elbow", "r_elbow", "l_wrist", "r_wrist", "l_hand", "r_hand"),
)


def landmarks() -> np.ndarray:
    """A person in front of the camera, metres: x right, y down, z forward, (F, 16, 3)."""
    points = RNG.uniform(-0.4, 0.4, (1, 16, 3)) + 0.05 * RNG.normal(size=(FRAMES, 16, 3))
    return points * (1, 2, 1) + (0.3, 0.1, 4.0)


def smpl(points: np.ndarray) -> np.ndarray:
    joints = np.array([0, 0, 5.0]) + RNG.normal(size=(FRAMES, 24, 3))
    for index, name in enumerate(SMPL):
        if name in LANDMARKS:
            joints[:, index] = points[:, LANDMARKS.index(name)]
    return joints


def sam(points: np.ndarray, pixels: np.ndarray) -> dict[str, np.ndarray]:
    """The 70 points of MHR, about an origin of their own."""
    names = {"l_shoulder": 5, "r_shoulder": 6, "l_elbow": 7, "r_elbow": 8, "l_hip": 9,
             "r_hip": 10, "l_knee": 11, "r_knee": 12, "l_ankle": 13, "r_ankle": 14, "l_toe": 15,
             "r_toe": 18, "r_wrist": 41, "l_wrist": 62, "neck": 69}  # fmt: skip
    joints, seen = RNG.normal(size=(FRAMES, 70, 3)), RNG.uniform(1, 600, (FRAMES, 70, 2))
    shift = RNG.normal(size=(FRAMES, 3))
    crown = points[:, LANDMARKS.index("head_top")] - shift
    joints[:, :5] = crown[:, None] + (0, 0.1, 0)  # the face below the crown
    for name, index in names.items():
        joints[:, index] = points[:, LANDMARKS.index(name)] - shift
        seen[:, index] = pixels[:, LANDMARKS.index(name)] + 0.5
    return {
        "pred_keypoints_3d": joints,
        "pred_cam_t": shift,
        "pred_keypoints_2d": seen,
        "focal_length": np.full(FRAMES, 900.0),
    }


def projected(points: np.ndarray) -> np.ndarray:
    found = points @ K.T
    return found[..., :2] / found[..., 2:] - 0.5


def centred(points: np.ndarray) -> np.ndarray:
    hips = [LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip")]
    return points - points[:, hips].mean(1, keepdims=True)


def smpl_arrays() -> dict[str, Any]:
    """A file of joints of SMPL."""
    points = landmarks()
    crown = points[:, LANDMARKS.index("head_top")]
    return {"smpl_joints": smpl(points), "camera": K, "head_top": crown}


def sam_arrays() -> dict[str, Any]:
    """A file of points of SAM 3D Body."""
    points = landmarks()
    return sam(points, projected(points))
