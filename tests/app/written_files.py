"""What a capture leaves in its folder."""

import json
from pathlib import Path

import numpy as np

FILES = ["capture.glb", "config.yaml", "motion.bvh", "motion.npz", "overlay.mp4", "run.json"]


def motion(folder: Path) -> dict[str, np.ndarray]:
    with np.load(folder / "motion.npz", allow_pickle=False) as data:
        return {name: data[name] for name in data.files}


def report(folder: Path) -> dict[str, object]:
    loaded: dict[str, object] = json.loads((folder / "run.json").read_text())
    return loaded
