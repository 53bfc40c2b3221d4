"""Numbers for spreadsheets and scripts: CSV and npz."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.geometry.rotation import aligned
from perfcap.io.archive import read_archive
from perfcap.io.atomic import writing
from perfcap.io.export.options import Options
from perfcap.io.export.recording import Recording
from perfcap.io.surface_file import save_vertices

Floats = NDArray[np.float64]

_MOST = 1e9  # metres or radians
_ANGLES = ("root_translation", "root_rotation", "angles", "angle_names")


def write_csv(folder: Path, recording: Recording, options: Options) -> None:
    """Landmarks, and joint angles in degrees where the capture has them; a row a frame."""
    unit = options.per_metre
    columns = [f"{name}_{axis}" for name in LANDMARKS for axis in "xyz"]
    landmarks = recording.landmarks.reshape(recording.frames, -1) * unit
    write_table(folder / f"{recording.name}_joints.csv", recording, columns, landmarks)
    motion = read_motion(recording)
    if motion is None:
        return
    angles = np.degrees(motion["angles"])
    names = [f"{name}_deg" for name in motion["angle_names"].tolist()]
    turn = Rotation.from_rotvec(motion["root_rotation"]).as_quat(scalar_first=True)
    turn = aligned(torch.from_numpy(turn)).numpy()  # no jumps between q and -q
    values = np.concatenate([motion["root_translation"] * unit, turn, angles], axis=1)
    columns = [*(f"root_{axis}" for axis in "xyz"), *(f"root_q{axis}" for axis in "wxyz"), *names]
    write_table(folder / f"{recording.name}_angles.csv", recording, columns, values)
    _write_ranges(folder / f"{recording.name}_ranges.csv", recording, motion)


def _write_ranges(path: Path, recording: Recording, motion: dict[str, NDArray[Any]]) -> None:
    """Limits of each angle, and what of them the frames use, in degrees; a row an angle."""
    names = ("angle_lower", "angle_upper")
    source = recording.result.folder / "motion.npz"
    found = read_archive(source, names, "the motion.npz of a capture")
    angles, count = np.degrees(motion["angles"]), len(motion["angle_names"])
    none = np.full(count, np.nan)
    limits = [found.get(name, none) for name in names]
    limits = [each if each.shape == (count,) else none for each in limits]
    if any(limit.dtype.kind != "f" for limit in limits):
        limits = [none, none]
    least, most = angles.min(0), angles.max(0)
    columns = (*np.degrees(limits), least, most, angles.mean(0), most - least)
    lines = ["angle,lower_deg,upper_deg,least_deg,most_deg,mean_deg,range_deg"]
    for name, *values in zip(motion["angle_names"].tolist(), *columns, strict=True):
        lines.append(f"{name}," + ",".join(f"{value:.9g}" for value in values))
    with writing(path) as file:
        file.write(("\n".join(lines) + "\n").encode())


def write_npz(folder: Path, recording: Recording, options: Options) -> None:
    """Everything as arrays: motion, skeleton, skin, texture coordinates and vertices.

    ``bone_transforms`` move the surface at rest, as skinning does: each is the pose of a bone in
    the world times the inverse of ``bone_rest``, so poses are ``bone_transforms @ bone_rest``.
    """
    template = recording.template
    arrays: dict[str, NDArray[Any]] = {
        "fps": np.array(recording.rate),
        "unit": np.array(options.unit),  # of all lengths here
        "frames": recording.numbers,
        "joints3d": recording.landmarks * options.per_metre,
        "joint_names": np.array(LANDMARKS),
        "faces": template.faces.astype(np.int32),
        "bone_names": np.array(template.bone_names),
        "bone_parents": template.bone_parents,
        "bone_rest": _scaled(template.bone_rest, options),
        "bone_transforms": _scaled(recording.bone_transforms, options),
        "weight_bones": template.weight_bones.astype(np.int32),
        "weights": template.weights.astype(np.float32),
        "rest_vertices": (template.vertices * options.per_metre).astype(np.float32),
    }
    if template.uv is not None:
        arrays["uv"] = template.uv.astype(np.float32)
    motion = read_motion(recording)
    if motion is not None:
        motion["root_translation"] = motion["root_translation"] * options.per_metre
        arrays |= motion
    unit = np.float32(options.per_metre)
    blocks = (block * unit for block in recording.blocks())
    save_vertices(folder / f"{recording.name}.npz", blocks, recording.frames, arrays)


def read_motion(recording: Recording) -> dict[str, NDArray[Any]] | None:
    """Root and angles of the frames, in the axes of the recording; None in older results.

    ``root_rotation`` takes the rest pose, with the axes of the recording, to the world.

    Raises:
        InputError: they are no numbers.
    """
    path = recording.result.folder / "motion.npz"
    found = read_archive(path, _ANGLES, "the motion.npz of a capture")
    count = recording.result.frames
    whole = set(found) == set(_ANGLES) and all(
        found[name].shape[:1] == (count,) and found[name].dtype.kind == "f"
        for name in _ANGLES[:3]
    )  # fmt: skip
    whole = whole and all(found[name].shape[1:] == (3,) for name in _ANGLES[:2])
    if not whole or found["angles"].shape[1:] != found["angle_names"].shape:
        return None
    for name in _ANGLES[:3]:
        if not (np.abs(found[name]) < _MOST).all():
            raise InputError(f"{path}: {name} holds what is no number or too large; capture again")
    moved = {name: found[name][recording.first : recording.stop] for name in _ANGLES[:3]}
    axes, upright = recording.axes, recording.upright
    turn = axes @ upright @ Rotation.from_rotvec(moved["root_rotation"]).as_matrix() @ axes.T
    moved["root_rotation"] = Rotation.from_matrix(turn).as_rotvec()
    moved["root_translation"] = moved["root_translation"] @ (axes @ upright).T
    return moved | {"angle_names": found["angle_names"]}


def _scaled(transforms: Floats, options: Options) -> Floats:
    scaled = transforms.copy()
    scaled[..., :3, 3] *= options.per_metre
    return scaled


def write_table(path: Path, recording: Recording, columns: Sequence[str], values: Floats) -> None:
    """A CSV with the number and time of each frame before its values, (F, columns)."""
    lines = [",".join(["frame", "time_s", *columns])]
    for number, time, row in zip(recording.numbers, recording.times, values, strict=True):
        lines.append(f"{number},{time:.9f}," + ",".join(f"{value:.9g}" for value in row))
    with writing(path) as file:
        file.write(("\n".join(lines) + "\n").encode())


# --- Motion of robots as simulators take it: MuJoCo's ``qpos``, as npz and CSV --------------------

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
