"""Errors by joint and by kind of motion, under each alignment, one view (MPC-E6; X10)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
import torch
from pose_refiner import Experiment as Refining
from pose_refiner import library, one_view
from report import Report, Table
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.metrics import Alignment, action_table, aligned_distances, joint_table
from perfcap.pipeline import PoseRefiner

# what the people of the library do, by the index of mocap.cs.cmu.edu
_ACTIONS = {
    "01": "playground",
    "02": "various",
    "03": "uneven ground",
    "05": "dance",
    "06": "basketball",
    "07": "walk",
}
_RATE = 30.0
_SHOWN = (
    Alignment.ABSOLUTE, Alignment.ROOT, Alignment.TRANSLATION, Alignment.SIMILARITY,
    Alignment.FIRST_FRAME,
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    clips: int = 1000
    """Of the library, at most."""
    frames: int = 300
    """Of each, at most, at 30 Hz."""
    seed: int = 0
    """Of detections and cameras."""


def run(config: Experiment) -> Report:
    """Capture every clip once, and tell its errors in every way."""
    torch.set_num_threads(1)
    settings = Refining(data=config.data, clips=config.clips, frames=config.frames)
    before: dict[Alignment, dict[str, list[Tensor]]] = {kind: {} for kind in _SHOWN}
    after: dict[Alignment, dict[str, list[Tensor]]] = {kind: {} for kind in _SHOWN}
    for index, clip in enumerate(library(settings)):
        guess = one_view(clip, np.random.default_rng([config.seed, index]), settings)
        refined = PoseRefiner(clip.actor, rate=_RATE).eval()(guess.cameras, **guess.inputs)
        action = _ACTIONS[clip.name.split("_")[0]]
        for kind in _SHOWN:
            for table, joints in ((before, guess.joints), (after, refined.joints)):
                errors = distances(joints, clip.truth, kind)
                table[kind].setdefault(action, []).append(errors)
    return Report((*_by_action(before, after), _by_joint(before, after)), (
        "One view, simulated 2D and 3D detections, the person's own bones. Detections are lifted "
        "to where they project. First frame: without the offset in the body that each joint has "
        "in the first frame. The mean is that of the actions, however long.",
    ))  # fmt: skip


def distances(joints: Tensor, truth: Tensor, kind: Alignment) -> Tensor:
    """Of joints after an alignment, (F, J) mm."""
    valid = torch.ones(truth.shape[:-1], dtype=torch.bool)
    return aligned_distances(joints, truth, valid, kind)


def _by_action(*tables: dict[Alignment, dict[str, list[Tensor]]]) -> Sequence[Table]:
    columns = ("motion", *(kind.name.lower().replace("_", " ") for kind in _SHOWN))
    result = []
    for title, table in zip(("detections", "after the window solve"), tables, strict=True):
        means = {kind: action_table(table[kind]) for kind in _SHOWN}
        names = means[Alignment.ABSOLUTE]
        rows = [(name, *(float(means[kind][name]) for kind in _SHOWN)) for name in names]
        result.append(Table(f"by motion, {title}, mm", columns, tuple(rows)))
    return result


def _by_joint(*tables: dict[Alignment, dict[str, list[Tensor]]]) -> Table:
    """Root-relative, and after similarities, before and after the solve."""
    kinds = (Alignment.ROOT, Alignment.SIMILARITY)
    found = []
    for kind in kinds:
        for table in tables:
            takes = [take for some in table[kind].values() for take in some]
            found.append(joint_table(torch.cat(takes), LANDMARKS))
    rows = [(name, *(float(means[name]) for means in found)) for name in LANDMARKS]
    columns = ("joint", *(f"{k.name.lower()}, {w}" for k in kinds for w in ("detected", "solved")))
    return Table("by joint, all clips, mm", columns, tuple(rows))


if __name__ == "__main__":
    report.main(run, Experiment, "joint_table")
