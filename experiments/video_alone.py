"""Captures of nothing but a video, scored: no camera, no character, no detections, no height.

The rendered sequences have exact truth; that of the real man is triangulated from other detections
in four views, good to some centimetres. Truth is used to score alone.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import report
import torch
from feet import FEET
from recordings import balancing, rendered
from report import Report, Table, data_folder
from torch import Tensor

from perfcap.app.capture import run_capture
from perfcap.commands.capture import Capture, Until
from perfcap.io.calibration import read_cameras
from perfcap.io.calibration.assumed import ASSUMED_FOV
from perfcap.metrics import floor_contact, foot_skate, joint_errors

_REAL = "pose2sim_balancing"


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt", "dev_coat")
    """Of the rendered set."""
    views: tuple[int, ...] = (0, 1, 2, 3)
    """Of the real man's, each captured alone."""
    detector: tuple[str, ...] = ()
    """Networks to use instead of the default."""
    until: Until = "track_motion"
    """The last stage to run."""
    fovs: tuple[float, ...] = field(default_factory=tuple)
    """Degrees to assume across the longer side, in turn; perfcap's own if none is given."""
    keep: Path | None = None
    """Folder to keep the captures in, with pictures."""


@dataclass(frozen=True)
class Video:
    """A video, and the truth about its joints: (F, 16, 3) m, NaN where unknown; its axis up.

    ``upright`` is up in the axes of the true camera of the first frame, (3,).
    """

    name: str
    path: Path
    truth: Tensor
    rate: float
    upright: Tensor
    up: int = 1


def run(config: Experiment) -> Report:
    """PA-MPJPE of each video, for each assumed lens."""
    rows: list[tuple[str | float, ...]] = []
    for fov in config.fovs or (None,):
        found = [_row(config, video, fov) for video in videos(config)]
        real = [row for row in found if str(row[0]).startswith(_REAL)]
        rows += found
        if len(real) > 1:
            rows.append(
                (f"{_REAL}, mean", *np.mean([[float(x) for x in r[1:]] for r in real], 0).tolist())
            )
    columns = (
        "video",
        "field of view",
        "PA-MPJPE mm",
        "acceleration error",
        "slide",
        "true slide",
        "up off by degrees",
        "CPU ms a frame",
    )
    return Report((Table("a video alone", columns, tuple(rows)),), ())


def videos(config: Experiment) -> list[Video]:
    """Of the rendered sequences and of the real man's views."""
    found = []
    for name in config.sequences:
        known = rendered(config.data, name)
        own = known.cameras.every_frame(1).rotation[0, 0, :, 1]
        found.append(Video(name, known.folder / "video.mp4", known.truth, known.rate, own))
    if config.views:
        real = balancing(config.data)
        folder = data_folder(config.data, _REAL) / "videos"
        for view in config.views:
            name = real.rig.names[view]
            path = sorted(folder.glob("*.mp4"))[view]  # in the order of the calibration
            own = real.cameras.rotation[view, :, 2]
            found.append(Video(f"{_REAL}, {name}", path, real.truth, real.rate, own, 2))
    return found


def _row(config: Experiment, video: Video, fov: float | None) -> tuple[str | float, ...]:
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) if config.keep is None else config.keep / video.path.parent.name
        folder = out / f"{video.name.replace(', ', '_')}"
        joints, spent = captured(config, video, fov, folder)
        lean = _lean(folder, video.upright)
    frames = min(len(joints), len(video.truth))
    errors = joint_errors(joints[:frames], video.truth[:frames].double(), video.rate)
    scores = float(errors.mpjpe_similarity), float(errors.acceleration_error)
    slides = _slides(joints[:frames], video.truth[:frames].double(), video)
    return (video.name, fov or ASSUMED_FOV, *scores, *slides, lean, 1e3 * spent / frames)


def _lean(out: Path, upright: Tensor) -> float:
    """Degrees between up of the capture's world and the true one, in axes of the camera."""
    found = read_cameras(out / "assumed_camera.json").cameras.rotation.reshape(-1, 3, 3)[0, :, 1]
    return float((found.to(upright) @ upright).clamp(-1, 1).arccos().rad2deg())


def _slides(joints: Tensor, truth: Tensor, video: Video) -> tuple[float, float]:
    """Millimetres a frame that feet slide while the true ones stand, and the true ones' own."""
    standing = truth[:, FEET]
    known = standing.isfinite().all(-1).any(0)
    standing, feet = standing[:, known], joints[:, FEET][:, known]
    ups = torch.eye(3, dtype=torch.float64)
    contact = floor_contact(standing, standing @ ups[video.up], video.rate)
    own = foot_skate(feet, contact, ups[1])  # worlds of captures have y up
    return float(own), float(foot_skate(standing, contact, ups[video.up]))


def captured(
    config: Experiment, video: Video, fov: float | None, out: Path
) -> tuple[Tensor, float]:
    """Joints (F, 16, 3) of a capture into a folder, and its processor time, s."""
    start = time.process_time()
    request = Capture(
        videos=(video.path,),
        out=out,
        fov=fov,
        detector=config.detector,
        lifter="cmu",
        until=config.until,
        overlay=config.keep is not None,
        overwrite=True,
    )
    run_capture(request)
    spent = time.process_time() - start
    with np.load(out / "motion.npz") as file:
        return torch.from_numpy(file["joints3d"]).double(), spent


if __name__ == "__main__":
    report.main(run, Experiment, "video_alone")
