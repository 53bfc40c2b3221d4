"""Smooth joints with free coefficients (Huang et al. 2017, Eq. 8) against a null space of the pose.

Recorded motion on which no setting was chosen, as fast as it was (slow) and half again as fast,
in two and in four views of a simulated detector. Paths: windows of 30 frames whose joints follow so
many cosines, robustly, and nothing else ties frames together. Null space: the prior of the default
capture, with its rank (of 50 frames at 30 Hz), solved once. Adapted: the default.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cmu
import numpy as np
import report
import torch
from fast_motion import HELD_OUT, Take, active, around, observed, tracked
from report import Report, Table
from window_problem import bare_actor

from perfcap.metrics import joint_errors
from perfcap.pipeline.config import MUVS_POSE, EvidenceConfig, PathConfig, PoseConfig

_RATE = 30.0


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    views: tuple[int, ...] = (2, 4)
    """Numbers of views."""
    ranks: tuple[int, ...] = (6, 10, 16, 24)
    """Cosines, of 30 frames for paths and of 50 for the null space."""
    clips: int = 6
    """Of the library, at most."""
    frames: int = 60
    """Of a clip, at most."""
    seed: int = 3
    """Of cameras and noise."""


def run(config: Experiment) -> Report:
    """A row for each prior and rank."""
    torch.set_num_threads(1)
    once = replace(PoseConfig(), evidence=EvidenceConfig(enabled=False))
    named = {"adapted (default)": PoseConfig()}
    for rank in config.ranks:
        trajectory = replace(once.trajectory, rank=rank)
        named[f"null space, {rank}"] = replace(once, trajectory=trajectory)
        named[f"paths, {rank}"] = replace(MUVS_POSE, paths=PathConfig(rank=rank))
    rows = []
    for views in config.views:
        for speed, step in (("slow", 2), ("fast", 3)):
            found = list(takes(config, views, step))
            rows += [(views, speed, name, *_scores(found, c)) for name, c in named.items()]
    columns = (
        "views",
        "speed",
        "prior, rank",
        "error, mm",
        "accel",
        "jerk ratio",
        "CPU s a window",
    )
    return Report((Table("medians over clips", columns, tuple(rows), 2),))


def takes(config: Experiment, views: int, step: int) -> Iterator[Take]:
    """Clips at a speed."""
    root = report.data_folder(config.data, "mocap_cmu_library")
    for number, name in enumerate(HELD_OUT[: config.clips]):
        truth = active(cmu.landmarks(root, name, step), config.frames)
        rng = np.random.default_rng([config.seed, number, step, views])
        cameras = around(truth, views, rng)
        actor = bare_actor(cmu.skeleton(root, name))
        yield Take(name, actor, cameras, observed(truth, cameras, rng, None), truth)


def _scores(found: list[Take], config: PoseConfig) -> tuple[float, ...]:
    rows = []
    for take in found:
        start = time.process_time()
        joints = tracked(take, config)
        spent = (time.process_time() - start) / max(1.0, len(joints) / config.window)
        error = joint_errors(joints, take.truth, _RATE)
        jerk = float(error.jerk / error.jerk_truth)
        rows.append((float(error.mpjpe), float(error.acceleration_error), jerk, spent))
    return tuple(float(value) for value in np.median(rows, 0))


if __name__ == "__main__":
    report.main(run, Experiment, "trajectory_prior")
