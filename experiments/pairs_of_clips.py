"""Joints of both sides exchanged in 3D poses of short clips: how often named, and of right ones.

Stretches of the rendered sequences with their simulated detections, whose errors stay for a while.
What is named of right poses is a false alarm. ``examine_pairs`` is what captures and doctor ask.
Its thresholds were chosen with the same clips in view.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import report
import torch
from recordings import rendered
from report import Report, Table
from torch import Tensor

from perfcap.io.doctor.pairs import examine_pairs, exchange

_LIMBS: tuple[tuple[str, ...], ...] = (
    *(("elbow",), ("wrist",), ("knee",), ("ankle",), ("toe",)),
    *(("elbow", "wrist"), ("knee", "ankle", "toe"), ("knee", "ankle"), ("ankle", "toe")),
)


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_coat", "dev_skirt", "dev_tight")
    """Rendered ones of one view."""
    lengths: tuple[int, ...] = (10, 12, 15, 20, 25, 30)
    """Frames of the stretches."""
    every: int = 5
    """Frames between the starts of stretches with exchanged joints; right ones start at each."""


def run(config: Experiment) -> Report:
    """A row for each length of stretches."""
    torch.set_num_threads(1)
    poses = []
    for name in config.sequences:
        given = rendered(config.data, name).detections
        assert given.joints3d is not None
        poses.append(given.joints3d[:, 0][given.trusted3d[:, 0]])
    rows = []
    for length in config.lengths:
        right = [bool(examine_pairs("", each)) for each in _stretches(poses, length, 1)]
        spoiled = list(_stretches(poses, length, config.every))
        shares = [
            100
            * sum(bool(examine_pairs("", exchange(limb, each))) for each in spoiled)
            / len(spoiled)
            for limb in _LIMBS
        ]
        rows.append((length, len(right), sum(right), *shares))
    columns = ("frames", "right", "refused", *(f"{'s, '.join(limb)}s, %" for limb in _LIMBS))
    return Report((Table("joints of both sides exchanged", columns, tuple(rows), 0),))


def _stretches(poses: list[Tensor], length: int, every: int) -> Iterator[Tensor]:
    """Poses (length, 16, 3), so many frames apart."""
    for each in poses:
        for start in range(0, len(each) - length + 1, every):
            yield each[start : start + length]


if __name__ == "__main__":
    report.main(run, Experiment, "pairs_of_clips")
