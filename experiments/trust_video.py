"""Trust of videos alone: learned on videos of rendered people, scored on recordings.

Fits the weights of ``perfcap.pipeline.trust`` for one view whose 3D poses are lifted, and the error
that ``perfcap.detect.pose_fusion`` expects. A frame is bad where the error after a similarity is
above 120 mm, or a joint is then 0.3 m off. Recordings are scored alone; nothing is fitted to them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np
import report
import torch
from filmed_people import films
from numpy.typing import NDArray
from report import Report, Table, data_folder
from torch import Tensor
from trust import FAR, OFF, shares
from video_alone import Experiment as Videos
from video_alone import videos

from perfcap.app.capture import run_capture
from perfcap.commands.capture import Capture
from perfcap.geometry.alignment import procrustes
from perfcap.pipeline.trust import FEATURES, THRESHOLD, frame_evidence, judge_frames
from perfcap.train.motion_library import MotionLibrary

_NAMED = 0.1  # of the good frames, that may be named by mistake
_RIDGE = 0.2  # of the variance: features of few videos go together
_FOLDS = 6

Floats = NDArray[np.float64]


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


@dataclass(frozen=True)
class Judged:
    """A capture of a video alone: what is known of each frame, and its errors in metres."""

    name: str
    evidence: Tensor
    error: Tensor
    worst: Tensor

    @property
    def bad(self) -> Tensor:
        """Frames, (F,), bool."""
        return (self.error > FAR) | (self.worst > OFF)


def run(config: Experiment) -> Report:
    """Weights, how well they do on films that are left out, and on recordings."""
    torch.set_num_threads(1)
    made = list(_films(config))
    bad, errors = (_fitted(made, kind) for kind in ("bad", "error"))
    weights: tuple[tuple[object, ...], ...] = tuple(
        (name, *(float(part) for part in row))
        for name, *row in zip((*FEATURES, "constant"), bad, errors, strict=True)
    )
    left_out = _left_out(made)
    rows: list[tuple[object, ...]] = [("films left out", *left_out)]
    if config.recordings:
        settings = Videos(config.data)
        real = [_judged(v.name, v.path, v.truth) for v in videos(settings)]
        rows += [(each.name, *shares(each.bad, _named(each))) for each in real]
        bad_ones = torch.cat([each.bad for each in real])
        named = torch.cat([_named(each) for each in real])
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


def _left_out(made: Sequence[Judged]) -> tuple[int, int, float, float]:
    """Shares of films that the weights were not fitted to, at the threshold that they choose."""
    bad, named = [], []
    for fold in range(_FOLDS):
        weights = _fitted([m for i, m in enumerate(made) if i % _FOLDS != fold], "bad")
        for each in made[fold::_FOLDS]:
            bad.append(each.bad)
            above = _rows([each]) @ weights > _log_odds(1 - THRESHOLD)
            named.append(torch.from_numpy(above))
    return shares(torch.cat(bad), torch.cat(named))


def _fitted(made: Sequence[Judged], kind: str) -> Floats:
    """Weights of the features and of the constant, by logistic or linear ridge regression.

    The constant of the former is moved so that a tenth of the good frames is named: films are
    harder than what people film.
    """
    rows, bad = _rows(made), torch.cat([each.bad for each in made]).numpy()
    mean, spread = rows[:, :-1].mean(0), rows[:, :-1].std(0)
    moving = spread > 1e-6  # the number of views is always one
    scaled = np.where(moving, (rows[:, :-1] - mean) / np.where(moving, spread, 1), 0)
    scaled = np.concatenate((scaled, np.ones((len(rows), 1))), 1)
    ridge = _RIDGE * len(rows) * np.diag([*[1.0] * (scaled.shape[1] - 1), 0.0])
    ridge += 1e-9 * np.eye(len(ridge))
    if kind == "error":
        errors = np.concatenate([each.error.numpy() for each in made])
        found = np.linalg.solve(scaled.T @ scaled + ridge, scaled.T @ np.log(1e3 * errors))
    else:
        found = np.zeros(scaled.shape[1])
        for _ in range(50):  # Newton's method
            odds = 1 / (1 + np.exp(-scaled @ found))
            hessian = (scaled * (odds * (1 - odds))[:, None]).T @ scaled + ridge
            found = found - np.linalg.solve(hessian, scaled.T @ (odds - bad) + ridge @ found)
        good = np.quantile((scaled @ found)[~bad], 1 - _NAMED)
        found[-1] += _log_odds(1 - THRESHOLD) - good
    weights = np.where(moving, found[:-1] / np.where(moving, spread, 1), 0)
    return np.append(weights, found[-1] - weights @ mean)


def _rows(made: Sequence[Judged]) -> Floats:
    evidence = torch.cat([each.evidence for each in made]).nan_to_num(np.log(0.15)).numpy()
    return np.concatenate((evidence, np.ones((len(evidence), 1))), 1)


def _log_odds(probability: float) -> float:
    return float(np.log(probability / (1 - probability)))


def _named(each: Judged) -> Tensor:
    return judge_frames(each.evidence).value < THRESHOLD


if __name__ == "__main__":
    report.main(run, Experiment, "trust_video")
