"""Trust of videos alone: learned on videos of rendered people, scored on recordings.

Fits the weights of ``perfcap.pipeline.trust`` for one view whose 3D poses are lifted, and the error
that ``perfcap.detect.pose_fusion`` expects. A frame is bad where the error after a similarity is
above 120 mm, or a joint is then 0.3 m off. Recordings are scored alone; nothing is fitted to them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np
import report
import torch
from filmed_people import films
from report import Report, Table, data_folder
from torch import Tensor
from trust_model import Fit, Judged, shares, weight_rows
from video_alone import Experiment as Videos
from video_alone import videos

from perfcap.app.capture import run_capture
from perfcap.commands.capture import Capture
from perfcap.geometry.alignment import procrustes
from perfcap.pipeline.trust import frame_evidence
from perfcap.train.motion_library import MotionLibrary

# films are harder than what people film; features of few videos go together
_FIT = Fit(named=0.1, ridge=0.2)
_FOLDS = 6


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings, with mocap_cmu_library in it."""
    level: int = 24
    """Videos of people who move as recorded."""
    hard: int = 60
    """Videos of people who move farther, seen from below and above."""
    frames: int = 36
    """Of each."""
    size: int = 384
    """Pixels along their square images."""
    recordings: bool = True
    """Whether to score recordings too."""


def run(config: Experiment) -> Report:
    """Weights, how well they do on films that are left out, and on recordings."""
    torch.set_num_threads(1)
    made = list(_films(config))
    weights = weight_rows(_FIT.bad(made), _FIT.error(made))
    folds = [index % _FOLDS for index in range(len(made))]
    bad = torch.cat([each.bad for each in made])
    rows: list[tuple[object, ...]] = [
        ("films left out", *shares(bad, torch.cat(_FIT.left_out(made, folds))))
    ]
    if config.recordings:
        settings = Videos(config.data)
        real = [_judged(v.name, v.path, v.truth) for v in videos(settings)]
        rows += [(each.name, *shares(each.bad, each.named)) for each in real]
        bad_ones = torch.cat([each.bad for each in real])
        named = torch.cat([each.named for each in real])
        rows.append(("all recordings", *shares(bad_ones, named)))
    columns = ("video", "frames", "bad", "bad named %", "good named %")
    return Report(
        (
            Table("weights", ("feature", "log odds of a bad frame", "log error, mm"), weights, 3),
            Table("frames named by trust", columns, tuple(rows), 0),
        )
    )


def _films(config: Experiment) -> Iterator[Judged]:
    library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    with tempfile.TemporaryDirectory() as folder:
        for count, hard, seed in ((config.level, False, 7), (config.hard, True, 11)):
            settings = config.frames, config.size, seed
            for film in films(Path(folder), library, count, *settings, hard=hard):
                yield _judged(film.name, film.path, film.truth)


def _judged(name: str, video: Path, truth: Tensor) -> Judged:
    seen: list[Tensor] = []

    def kept(*arguments: object) -> Tensor:
        seen.append(frame_evidence(*arguments))  # type: ignore[arg-type]
        return seen[-1]

    at = "perfcap.pipeline.trust.frame_evidence"
    with tempfile.TemporaryDirectory() as folder, mock.patch(at, kept):
        out = Path(folder) / "out"
        request = Capture(
            videos=(video,), out=out, lifter="cmu", until="track_motion", overlay=False
        )
        run_capture(request)
        with np.load(out / "motion.npz") as file:
            joints = torch.from_numpy(file["joints3d"]).double()
    count = min(len(joints), len(truth))
    joints, truth = joints[:count], truth[:count].double()
    known = truth.isfinite().all(-1).all(0)
    joints, truth = joints[:, known], truth[:, known]
    apart = (procrustes(joints, truth, scale=True).apply(joints) - truth).norm(dim=-1)
    return Judged(name, seen[0][:count], apart.mean(-1), apart.amax(-1))


if __name__ == "__main__":
    report.main(run, Experiment, "trust_video")
