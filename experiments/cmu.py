"""CMU motion capture as landmark trajectories and as motions of perfcap's skeleton.

Reads the packed library ``clips.npz`` (joint Euler angles of 31 joints at 60 Hz). Data from
mocap.cs.cmu.edu, created with funding from NSF EIA-0196217; free for all uses.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.anatomy import human_rig
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.detect.joint_set import LANDMARKS

# perfcap's joints and landmarks in the CMU skeleton; the crown lies 16 cm above the head's joint
_SOURCE = {
    "pelvis": "Hips", "spine": "Spine1", "neck": "Neck", "head": "Neck1", "head_top": "Head",
    "l_shoulder": "LeftArm", "l_elbow": "LeftForeArm", "l_wrist": "LeftHand",
    "r_shoulder": "RightArm", "r_elbow": "RightForeArm", "r_wrist": "RightHand",
    "l_hip": "LeftUpLeg", "l_knee": "LeftLeg", "l_ankle": "LeftFoot", "l_toe": "LeftToeBase",
    "r_hip": "RightUpLeg", "r_knee": "RightLeg", "r_ankle": "RightFoot", "r_toe": "RightToeBase",
}  # fmt: skip
_CROWN = np.array([0.0, 0.16, 0.0])


def clip_names(root: Path) -> list[str]:
    """Clips without capture errors, in the order of the index."""
    with (root / "clips.csv").open() as file:
        return [row["clip"] for row in csv.DictReader(file) if "glitch" not in row["remark"]]


def landmark_rest(root: Path, clip: str) -> dict[str, Tensor]:
    """Rest positions of a subject's joints and landmarks, metres, y up, facing +z."""
    data = np.load(root / "clips.npz", allow_pickle=False)
    names, parents = list(data["joint_names"]), data["parents"]
    offsets = data[f"{clip}/offsets_m"].astype(float)
    places = np.zeros_like(offsets)
    for joint, parent in enumerate(parents):
        places[joint] = offsets[joint] + (places[parent] if parent >= 0 else 0)
    rest = {ours: torch.tensor(places[names.index(theirs)]) for ours, theirs in _SOURCE.items()}
    rest["head_top"] = rest["head_top"] + torch.tensor(_CROWN)
    return rest


def landmarks(root: Path, clip: str, step: int = 2) -> Tensor:
    """Landmarks of a clip in the world, (F, 16, 3), metres, at 60 / step Hz."""
    names, rotation, places = _walk(root, clip, step)
    points = {name: places[:, names.index(_SOURCE[name])] for name in LANDMARKS}
    points["head_top"] = points["head_top"] + rotation[:, names.index("Head")] @ _CROWN
    return torch.tensor(np.stack([points[name] for name in LANDMARKS], 1))


def arms(root: Path, clip: str, side: str, step: int = 2) -> tuple[Tensor, ...]:
    """Where an arm points, and its thumb, seen from the shoulder girdle.

    Args:
        root: folder of the library.
        clip: its name.
        side: "l", or "r", which is mirrored to be a left one.
        step: every so many frames.

    Returns:
        Directions of the upper arm, of the forearm and of the side of the hand on which its thumb
        lies, each (F, 3), x left, y up, z ahead.
    """
    names, rotation, _ = _walk(root, clip, step)
    sign, word = (1.0, "Left") if side == "l" else (-1.0, "Right")
    girdle = rotation[:, names.index(f"{word}Shoulder")]
    mirror = np.array([sign, 1.0, 1.0])

    def seen(joint: str, axis: tuple[float, float, float]) -> Tensor:
        turned = girdle.swapaxes(-1, -2) @ rotation[:, names.index(word + joint)]
        return torch.tensor(turned @ np.array(axis) * mirror)

    along = (sign, 0.0, 0.0)
    return seen("Arm", along), seen("ForeArm", along), seen("Hand", (0.0, 0.0, 1.0))


def skeleton(root: Path, clip: str) -> Skeleton:
    """The 33-degree skeleton with a subject's bones."""
    return Skeleton(human_rig(landmark_rest(root, clip)))


def place(motion: Motion, skeleton: Skeleton, floor: float = 0.0) -> Motion:
    """Centre a motion over the origin with its lowest landmark on the floor."""
    points = skeleton(motion).landmarks
    centre = motion.translation.mean(0) * torch.tensor([1.0, 0.0, 1.0]).to(points)
    drop = torch.tensor([0.0, 1.0, 0.0]).to(points) * (points[..., 1].min() - floor)
    return Motion(motion.translation - centre - drop, motion.rotation, motion.angles)


def _walk(root: Path, clip: str, step: int) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names of the joints, their rotations (F, 31, 3, 3) and places (F, 31, 3) in the world."""
    data = np.load(root / "clips.npz", allow_pickle=False)
    names, parents = list(data["joint_names"]), data["parents"]
    euler = np.radians(data[f"{clip}/euler_zyx_deg"][::step].astype(float))
    offsets = data[f"{clip}/offsets_m"].astype(float)
    local = _euler_zyx(euler)
    rotation, places = local.copy(), np.zeros((*euler.shape[:2], 3))
    for joint, parent in enumerate(parents):
        if parent < 0:
            places[:, joint] = data[f"{clip}/root_m"][::step]
            continue
        rotation[:, joint] = rotation[:, parent] @ local[:, joint]
        places[:, joint] = places[:, parent] + rotation[:, parent] @ offsets[joint]
    return names, rotation, places


def _euler_zyx(angles: np.ndarray) -> np.ndarray:
    """Rz(a) Ry(b) Rx(c) of angles (..., 3) in the order z, y, x."""
    cosine, sine = np.cos(angles), np.sin(angles)
    cz, cy, cx = np.moveaxis(cosine, -1, 0)
    sz, sy, sx = np.moveaxis(sine, -1, 0)
    rows = (
        cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx,
        sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx,
        -sy, cy * sx, cy * cx,
    )  # fmt: skip
    stacked: np.ndarray = np.stack(rows, -1).reshape(*angles.shape[:-1], 3, 3)
    return stacked
