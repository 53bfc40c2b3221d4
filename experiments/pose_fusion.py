"""Poses in 3D of a lifter, of BlazePose, and of both together, on videos of rendered people.

Chooses the two numbers of ``perfcap.detect.pose_fusion``. The lifter has learned from the motion
of these people, BlazePose from nobody like them, so the lifter is better here than on others: the
share of BlazePose is chosen too small rather than too large.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
import torch
from filmed_people import Film, films
from report import Report, Table, data_folder
from torch import Tensor

from perfcap.app.networks import (
    DETECTORS,
    LIFTERS,
    Detecting,
    detect_clip,
    find_model,
)
from perfcap.commands.views import DEFAULT_DETECTORS, DEFAULT_LIFTER
from perfcap.detect.detections import Detections
from perfcap.detect.lifter import OnnxLifter
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.pose_fusion import fuse_poses
from perfcap.geometry.alignment import procrustes
from perfcap.io.calibration.assumed import assumed_rig
from perfcap.io.clip import Clip
from perfcap.train.motion_library import MotionLibrary


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings, with mocap_cmu_library in it."""
    clips: int = 24
    """Videos of people to make."""
    frames: int = 48
    """Of each."""
    size: int = 448
    """Pixels along their square images."""
    shares: tuple[float, ...] = (0.2, 0.35, 0.5)
    """Of the network's pose."""
    distances: tuple[float, ...] = (0.1, 0.15, 10.0)
    """Metres from which two poses contradict each other; the last one believes both."""


def run(config: Experiment) -> Report:
    """PA-MPJPE, mean over videos, for every pair of numbers."""
    torch.set_num_threads(1)
    library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    with tempfile.TemporaryDirectory() as folder:
        made = films(Path(folder), library, config.clips, config.frames, config.size)
        found = [(film, *_poses(film)) for film in made]
    rows: list[tuple[object, ...]] = [
        ("lifter", "", *_spread(_error(film, lifted) for film, lifted, _ in found)),
        ("BlazePose", "", *_spread(_error(film, seen) for film, _, seen in found)),
    ]
    for share in config.shares:
        for apart in config.distances:
            errors = (
                _error(film, fuse_poses(lifted, seen, share, apart)) for film, lifted, seen in found
            )
            rows.append((f"{share:g} of BlazePose", f"{apart:g} m", *_spread(errors)))
    columns = ("3D poses", "apart", "PA-MPJPE mm, mean", "median", "worst")
    return Report((Table("poses before the solve", columns, tuple(rows)),))


def _poses(film: Film) -> tuple[Detections, Detections]:
    """Of the lifter, and of the network that sees the image."""
    networks = tuple(OnnxDetector(find_model(name, DETECTORS)) for name in DEFAULT_DETECTORS)
    clip = Clip.open(film.path)
    cameras = assumed_rig(clip).cameras
    seen = detect_clip(clip, Detecting(networks, poses=True), cameras)
    lifter = OnnxLifter(find_model(DEFAULT_LIFTER, LIFTERS))
    return lifter(seen.without_poses(), cameras, clip.fps), seen


def _error(film: Film, found: Detections) -> float:
    """Mean over the frames that have a pose, millimetres; NaN without any."""
    if found.joints3d is None or not bool(found.trusted3d.any()):
        return float("nan")
    there = found.trusted3d[:, 0]
    poses: Tensor = found.joints3d[there, 0].double()
    truth = film.truth[there]
    fit = procrustes(poses, truth, scale=True)
    return 1e3 * float((fit.apply(poses) - truth).norm(dim=-1).mean())


def _spread(errors: Iterator[float]) -> tuple[float, float, float]:
    values = np.array(list(errors))
    return float(np.nanmean(values)), float(np.nanmedian(values)), float(np.nanmax(values))


if __name__ == "__main__":
    report.main(run, Experiment, "pose_fusion")
