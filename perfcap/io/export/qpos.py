"""Motion of robots as simulators take it: MuJoCo's ``qpos``, as npz and CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from perfcap.errors import InputError
from perfcap.geometry.rotation import aligned
from perfcap.io.atomic import writing
from perfcap.io.export.options import Options
from perfcap.io.export.recording import Recording
from perfcap.io.export.tables import read_motion, write_table

ROOT = ("root_x", "root_y", "root_z", "root_qw", "root_qx", "root_qy", "root_qz")


def write_qpos(folder: Path, recording: Recording, options: Options) -> None:
    """Place (3,) m and quaternion (w, x, y, z) of the root body, z up, then joints in radians.

    Joints come in the order of the robot's file, which is that of MuJoCo's ``qpos`` after a free
    joint; their names go along, so that no order has to be trusted.

    Raises:
        InputError: it is no motion of a robot.
    """
    joints = _joints(recording)
    motion = read_motion(recording)
    if motion is None or motion["angle_names"].tolist() != joints:
        raise InputError(
            f"{recording.result.folder}: its motion.npz and run.json name different joints; run "
            "perfcap retarget again"
        )
    root = recording.posed_bones[:, 0]
    turn = Rotation.from_matrix(root[:, :3, :3]).as_quat(scalar_first=True)
    turn = aligned(torch.from_numpy(turn)).numpy()  # no jumps between q and -q
    qpos = np.concatenate((root[:, :3, 3], turn, motion["angles"]), axis=1)
    with writing(folder / f"{recording.name}_qpos.npz") as file:
        np.savez_compressed(
            file,
            qpos=qpos,
            joint_names=np.array(joints),
            root_position=root[:, :3, 3],
            root_quaternion=turn,
            angles=motion["angles"],
            fps=np.array(recording.rate),
            frames=recording.numbers,
        )
    write_table(folder / f"{recording.name}_qpos.csv", recording, [*ROOT, *joints], qpos)


def _joints(recording: Recording) -> list[str]:
    robot = recording.result.report.get("robot")
    joints = robot.get("joints") if isinstance(robot, dict) else None
    if not isinstance(joints, list) or not all(isinstance(name, str) for name in joints):
        raise InputError(
            f"--to qpos: {recording.result.folder} is no motion of a robot; put it on one first: "
            f"perfcap retarget {recording.result.folder} --actor robot.xml --out robot"
        )
    return joints
