"""A small library of made-up motion, in the format of the packed CMU library."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

# name, parent, offset from it in metres (y up, facing +z, left is +x)
_JOINTS = (
    ("Hips", -1, (0, 0, 0)), ("Spine1", 0, (0, 0.25, 0)), ("Neck", 1, (0, 0.25, 0)),
    ("Neck1", 2, (0, 0.05, 0)), ("Head", 3, (0, 0.08, 0.02)),
    ("LeftArm", 1, (0.18, 0.22, 0)), ("LeftForeArm", 5, (0.28, 0, 0)),
    ("LeftHand", 6, (0.25, 0, 0)),
    ("RightArm", 1, (-0.18, 0.22, 0)), ("RightForeArm", 8, (-0.28, 0, 0)),
    ("RightHand", 9, (-0.25, 0, 0)),
    ("LeftUpLeg", 0, (0.1, -0.05, 0)), ("LeftLeg", 11, (0, -0.42, 0)),
    ("LeftFoot", 12, (0, -0.4, 0)),
    ("LeftToeBase", 13, (0, -0.05, 0.13)),
    ("RightUpLeg", 0, (-0.1, -0.05, 0)), ("RightLeg", 15, (0, -0.42, 0)),
    ("RightFoot", 16, (0, -0.4, 0)), ("RightToeBase", 17, (0, -0.05, 0.13)),
)  # fmt: skip


def write_library(folder: Path, people: int = 3, clips: int = 2, frames: int = 240) -> Path:
    """Clips of people who sway and turn; the last clip is marked as a glitch."""
    rng = np.random.default_rng(0)
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {
        "joint_names": np.array([name for name, _, _ in _JOINTS]),
        "parents": np.array([parent for _, parent, _ in _JOINTS]),
    }
    rows = []
    for person in range(1, people + 1):
        offsets = np.array([o for _, _, o in _JOINTS], float) * rng.uniform(0.9, 1.1)
        for number in range(1, clips + 1):
            clip = f"{person:02d}_{number:02d}"
            time = np.arange(frames)[:, None, None] / 60
            pace = rng.uniform(0.3, 1.2, (1, len(_JOINTS), 3))
            euler = rng.uniform(5, 30, pace.shape) * np.sin(
                2 * np.pi * pace * time + rng.uniform(0, 6, pace.shape)
            )
            arrays[f"{clip}/euler_zyx_deg"] = euler.astype(np.float16)
            root = np.stack(
                (0.3 * np.sin(time[:, 0, 0]), 0.95 + 0 * time[:, 0, 0], time[:, 0, 0] / 4)
            )
            arrays[f"{clip}/root_m"] = root.T.astype(np.float32)
            arrays[f"{clip}/offsets_m"] = offsets.astype(np.float32)
            rows.append((clip, f"{person:02d}", frames, frames / 60, ""))
    rows.append(("99_01", "99", 10, 0.2, "glitch"))
    np.savez(folder / "clips.npz", **arrays)
    with (folder / "clips.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("clip", "subject", "frames_60hz", "seconds", "remark"))
        writer.writerows(rows)
    return folder
