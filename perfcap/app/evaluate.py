"""``perfcap evaluate``: a result against its truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.io.atomic import writing
from perfcap.metrics import JointErrors, joint_errors

_UNKNOWN_FPS = 30.0
_TRUTH_NAMES = ("truth.npz", "gt.npz")
_ROWS = (
    ("pa_mpjpe_mm", "joints, similarity-aligned", "mm"),
    ("mpjpe_root_mm", "joints, root-aligned", "mm"),
    ("mpjpe_mm", "joints, absolute", "mm"),
    ("pck3d_150", "3DPCK at 150 mm", "%"),
    ("auc3d", "3DPCK area under curve", "%"),
    ("accel_err_mm_per_frame2", "acceleration error", "mm/frame²"),
    ("jitter_jerk_m_s3", "jerk", "m/s³"),
    ("jitter_jerk_gt_m_s3", "jerk of the truth", "m/s³"),
)


def run_evaluate(folder: Path, truth: Path) -> int:
    """Print the table and write metrics.json; returns the exit code.

    Raises:
        InputError: a file is missing or holds something else.
    """
    metrics = evaluate(folder / "motion.npz", find_truth(truth))
    with writing(folder / "metrics.json") as file:
        file.write(json.dumps(metrics, indent=1).encode())
    Console().print(error_table(metrics))
    return 0


def evaluate(result: Path, truth: Path) -> dict[str, float]:
    """Errors by the names of the scorer, for the frames that a result has."""
    found, true = _load(result), _load(truth)
    expected = true["joints3d"]
    index = {int(frame): row for row, frame in enumerate(true["frames"])}
    rows = [index.get(int(frame), -1) for frame in found["frames"]]
    if min(rows) < 0:
        raise InputError(
            f"{truth}: lacks {rows.count(-1)} of the {len(rows)} frames of {result}; expected all "
            "of them"
        )
    fps = float(found.get("fps", _UNKNOWN_FPS))
    joints = found["joints3d"].astype(float)
    errors = joint_errors(torch.tensor(joints), torch.tensor(expected[rows].astype(float)), fps)
    return _named(errors)


def error_table(metrics: dict[str, float]) -> Table:
    """The metrics for a terminal."""
    table = Table("error", "value", "unit")
    for key, title, unit in _ROWS:
        table.add_row(title, f"{metrics[key]:.1f}", unit)
    return table


def find_truth(path: Path) -> Path:
    """The truth file of a folder, or the file itself.

    Raises:
        InputError: there is none.
    """
    if path.is_file():
        return path
    for name in _TRUTH_NAMES:
        if (path / name).is_file():
            return path / name
    raise InputError(f"--truth {path}: no such file; expected an npz or a folder with truth.npz")


def _load(path: Path) -> dict[str, np.ndarray]:
    values = read_archive(path, ("joints3d", "frames", "fps"), "an npz with joints3d")
    joints = values.get("joints3d")
    if joints is None or joints.ndim != 3 or joints.shape[1:] != (16, 3) or not len(joints):
        found = "missing" if joints is None else f"of shape {joints.shape}"
        raise InputError(f"{path}: joints3d is {found}, expected (F, 16, 3) in metres")
    frames, fps = values.setdefault("frames", np.arange(len(joints))), values.get("fps")
    if frames.shape != joints.shape[:1] or frames.dtype.kind not in "iu":
        raise InputError(
            f"{path}: frames is {frames.dtype} {frames.shape}, expected {len(joints)} frame numbers"
        )
    if fps is not None and (fps.size != 1 or fps.dtype.kind not in "fiu" or not 0 < fps < 1e5):
        raise InputError(f"{path}: fps is {fps}, expected a positive number")
    if joints.dtype.kind not in "fiu" or not np.isfinite(joints).all():
        raise InputError(f"{path}: joints3d holds {joints.dtype} that are not all finite numbers")
    return values


def _named(errors: JointErrors) -> dict[str, float]:
    values = {
        "frames_scored": errors.frames,
        "mpjpe_mm": errors.mpjpe,
        "mpjpe_root_mm": errors.mpjpe_root,
        "mpjpe_transl_mm": errors.mpjpe_translation,
        "pa_mpjpe_mm": errors.mpjpe_similarity,
        "pck3d_150": errors.pck,
        "auc3d": errors.auc,
        "accel_err_mm_per_frame2": errors.acceleration_error,
        "jitter_jerk_m_s3": errors.jerk,
        "jitter_jerk_gt_m_s3": errors.jerk_truth,
    }
    return {name: float(value) for name, value in values.items()}
