"""Poses in 3D that are late or early against the 2D joints of their view: how often that is named.

Stretches of all clips of the CMU library, as a simulated detector of one view sees them. What is
named of poses in time is a false alarm. ``examine_lifted`` is what captures and doctor ask.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pose_refiner
import report
import torch
from report import Report, Table
from torch import Tensor

from perfcap.io.doctor import Finding
from perfcap.io.doctor.lifted import examine_lifted

Track = tuple[Tensor, Tensor, Tensor]


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    clips: int = 1000
    """Of the library, at most."""
    frames: int = 200
    """Of a clip, at most, at 30 Hz."""
    stretches: tuple[int, ...] = (15, 20, 30, 40, 60, 100, 200)
    """Frames of the stretches."""
    late: tuple[int, ...] = (0, 2, 3, 5, 6, -2, -3)
    """Frames by which poses are late, or early."""
    seed: int = 0
    """Of errors of the detector."""


def run(config: Experiment) -> Report:
    """A row for each length of stretches and each delay."""
    torch.set_num_threads(1)
    tracks = list(read_tracks(config))
    rows = []
    for length in config.stretches:
        for late in config.late:
            named = [
                any(f"{abs(late)} frames" in each.what or not late for each in found)
                for track in tracks
                for found in _examined(track, length, late)
            ]
            rows.append((length, late, len(named), sum(named), 100 * sum(named) / len(named)))
    columns = ("frames", "late by", "stretches", "named", "%")
    return Report((Table("3D poses of other frames", columns, tuple(rows), 0),))


def read_tracks(config: Experiment) -> Iterator[Track]:
    """Poses (F, 16, 3), joints on the plane (F, 16, 2) and confidence (F, 16) of each clip."""
    like = pose_refiner.Experiment(data=config.data, clips=config.clips, frames=config.frames)
    for index, clip in enumerate(pose_refiner.library(like)):
        rng = np.random.default_rng([config.seed, index])
        guess = pose_refiner.one_view(clip, rng, like)
        pixels, sure, poses = (
            guess.inputs[name] for name in ("joints2d", "confidence2d", "joints3d")
        )
        yield poses[:, 0], guess.cameras.to_plane(pixels)[:, 0], sure[:, 0]


def _examined(track: Track, length: int, late: int) -> Iterator[list[Finding]]:
    poses, plane, sure = track
    for start in range(0, len(poses) - length + 1, length):
        frames = torch.arange(start, start + length)
        given = poses[(frames - late).clamp(0, len(poses) - 1)]
        trusted = given.isfinite().flatten(1).all(-1)
        yield examine_lifted("view", given.nan_to_num(), plane[frames], sure[frames], trusted)


if __name__ == "__main__":
    report.main(run, Experiment, "late_poses")
