"""Limbs that no network sees, found in silhouettes: errors with and without the search.

Captures of videos alone until the refined pose. Films are of random people whose limbs turn up to
1.9 times as far as recorded, seen from below and from high above: what no lifter has learned.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

import numpy as np
import report
import torch
from filmed_people import films
from recordings import demo
from report import Report, Table, data_folder
from torch import Tensor
from video_alone import Experiment as Videos
from video_alone import Video, videos

from perfcap.app.capture import run_capture
from perfcap.commands.capture import Capture
from perfcap.geometry.alignment import procrustes
from perfcap.pipeline.lost_limbs import LostLimbsConfig
from perfcap.pipeline.presets import PRESETS
from perfcap.train.motion_library import MotionLibrary


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    films: int = 20
    """Random people."""
    frames: int = 48
    """Of each."""
    size: int = 480
    """Of their pictures, pixels."""
    seed: int = 31
    """Of the films."""
    recordings: bool = True
    """Whether the recordings are captured too, the shipped clip among them."""


def run(config: Experiment) -> Report:
    """Errors of the frames in which a limb was found, with it and without the search."""
    torch.set_num_threads(1)
    rows: list[tuple[str | float, ...]] = []
    count = 0
    with tempfile.TemporaryDirectory() as scratch:
        for video in _videos(config, Path(scratch)):
            count += 1
            rows += _rows(video, Path(scratch) / f"out{count}")
    columns = ("video", "limb", "frames", "PA-MPJPE mm", "without", "worst joint", "without it")
    note = f"{count} videos"
    return Report((Table("limbs found in silhouettes", columns, tuple(rows), 0),), (note,))


def _videos(config: Experiment, scratch: Path) -> Iterator[Video]:
    if config.recordings:
        known = demo()
        up = known.cameras.every_frame(1).rotation[0, 0, :, 1]
        yield Video("demo", known.folder / "video.mp4", known.truth, known.rate, up)
        yield from videos(Videos(config.data))
    if config.films:
        library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
        size = config.frames, config.size, config.seed, True
        for film in films(scratch, library, config.films, *size):
            up = film.camera.every_frame(1).rotation[0, 0, :, 1]
            yield Video(f"film {film.name}", film.path, film.truth, film.rate, up)


def _rows(video: Video, out: Path) -> Iterator[tuple[str | float, ...]]:
    call = Capture(videos=(video.path,), out=out, until="refine_pose", overlay=False)
    run_capture(call)
    seen = json.loads((out / "run.json").read_text())["refinement"]
    found = seen.get("lost_limbs", [])
    if not found:
        return
    off = replace(PRESETS["default"], lost_limbs=LostLimbsConfig(enabled=False))
    without = out.with_name(f"{out.name}_without")
    with mock.patch.dict(PRESETS, default=off):
        run_capture(replace(call, out=without))
    errors = [_errors(each, video.truth) for each in (out, without)]
    for each in found:
        part = slice(*each["frames"])
        means = [1000 * float(e[part].nanmean()) for e in errors]
        worst = [1000 * float(e[part].nan_to_num().amax(-1).mean()) for e in errors]
        yield (video.name, each["limb"], part.stop - part.start, *means, *worst)


def _errors(out: Path, truth: Tensor) -> Tensor:
    """Of each joint after a similarity, (F, J) m."""
    with np.load(out / "motion.npz") as file:
        joints = torch.from_numpy(file["joints3d"]).double()
    count = min(len(joints), len(truth))
    joints, truth = joints[:count], truth[:count].double()
    known = truth.isfinite().all(-1).all(0)
    joints, truth = joints[:, known], truth[:, known]
    apart: Tensor = (procrustes(joints, truth, scale=True).apply(joints) - truth).norm(dim=-1)
    return apart


if __name__ == "__main__":
    report.main(run, Experiment, "lost_limbs")
