"""The same inputs to what people use instead: triangulation and filters, Pose2Sim, BlazePose.

Several views: given 2D detections. *Plain* weighs views by confidence; *robust* down-weights views
that disagree; the Butterworth filter is of fourth order, without lag, at 6 Hz, after gaps are
filled linearly: the recipe of Pose2Sim and FreeMoCap. Pose2Sim itself with `--pose2sim PYTHON`, an
interpreter that has it. perfcap has the person's own template, or a body fitted to the joints. One
view: the video alone; BlazePose's world landmarks as they are, or filtered. Clips are turned to the
truth as a whole before accelerations are compared.

Of the real man, whose truth would be triangulated, the detections of each view are predicted from
the other three.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
import torch
from pose2sim_project import pose2sim
from recordings import Recording, balancing, rendered_views
from report import Report, Table
from scipy.signal import butter, sosfiltfilt
from torch import Tensor
from video_alone import Experiment as Alone
from video_alone import Video, captured, videos
from views_sweep import fitted_actor

from perfcap.app.networks import DETECTORS, Detecting, detect_clip, find_model
from perfcap.detect.onnx import OnnxDetector
from perfcap.geometry.alignment import procrustes
from perfcap.geometry.triangulation import triangulate
from perfcap.io.calibration.assumed import assumed_rig
from perfcap.io.clip import Clip
from perfcap.metrics import joint_errors
from perfcap.pipeline.jobs import capture

VIEWS = {
    "dev_views": ((0, 1, 2, 3, 4, 5), (0, 1, 3, 4), (0, 1)),
    "dev_dance": ((0, 1, 2, 3, 4, 5, 6), (0, 2, 4, 6), (0, 2)),
}
CUTOFF, ORDER = 6.0, 4  # Hz; both passes together
CONFIDENT = 0.3


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    pose2sim: Path | None = None
    """Python that has Pose2Sim; without, it is left out."""
    sequences: tuple[str, ...] = ("dev_views", "dev_dance")
    """Rendered in several views."""
    alone: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Rendered in one view that stands still."""
    real: bool = True
    """The real man too."""


def run(config: Experiment) -> Report:
    """One table for each kind of input."""
    rows = [
        (name, len(views), method, *_scores(found, whole))
        for name in config.sequences
        for whole in (rendered_views(config.data, name),)
        for views in VIEWS[name]
        for method, found in _methods(whole, list(views), config)
    ]
    columns = ("recording", "views", "method", "error mm", "offset removed", "95 %", "accel",
               "jerk ratio", "missing %")  # fmt: skip
    tables = [Table("several views, given detections", columns, tuple(rows), 1)]
    if config.real:
        tables.append(_unseen(config))
    if config.alone or config.real:
        tables.append(_alone(config))
    return Report(tuple(tables))


def _methods(
    whole: Recording, views: list[int], config: Experiment
) -> Iterator[tuple[str, Tensor]]:
    """Landmarks (F, 16, 3) by each method, from some views."""
    cameras, seen = whole.cameras.select(views), whole.detections.select(views)
    plane, weights = cameras.to_plane(seen.joints2d), seen.confidence2d
    weights = torch.where(weights > CONFIDENT, weights, 0)
    plain, robust = (triangulate(cameras, plane, weights, rounds)[0] for rounds in (0, 6))
    yield "plain triangulation", plain
    yield "plain, Butterworth", low_pass(plain, whole.rate)
    yield "robust triangulation", robust
    yield "robust, Butterworth", low_pass(robust, whole.rate)
    if config.pose2sim is not None:
        with tempfile.TemporaryDirectory() as scratch:
            place = Path(scratch) / "project"
            yield "Pose2Sim", pose2sim(config.pose2sim, place, cameras, seen, whole.rate)
    if whole.name == "balancing":
        solved = capture(whole.actor, cameras, seen, whole.rate, solve_bones=True)
        yield "perfcap, generic actor, bones solved", solved.joints()
        return
    yield "perfcap, own template", capture(whole.actor, cameras, seen, whole.rate).joints()
    body = fitted_actor(whole, views, seen)
    yield "perfcap, fitted body", capture(body, cameras, seen, whole.rate).joints()


def low_pass(points: Tensor, rate: float) -> Tensor:
    """Points (F, N, 3) filtered along time, gaps filled linearly; NaN where all are missing."""
    values = points.flatten(1).double().numpy().copy()
    frames = np.arange(len(values))
    for column in values.T:
        known = np.isfinite(column)
        if known.any():
            column[~known] = np.interp(frames[~known], frames[known], column[known])
    there = np.isfinite(values).all(0)
    sections = butter(ORDER // 2, CUTOFF, fs=rate, output="sos")
    values[:, there] = sosfiltfilt(sections, values[:, there], axis=0)
    return torch.tensor(values).reshape(points.shape)


def _scores(found: Tensor, whole: Recording) -> tuple[float, ...]:
    error = joint_errors(found, whole.truth, whole.rate, partial=True)
    apart = 1000 * (found - whole.truth).norm(dim=-1)
    missing = float(found.isnan().any(-1).double().mean())
    known = apart[apart.isfinite()]
    return (
        float(error.mpjpe), float(error.mpjpe_first_frame), float(known.quantile(0.95)),
        float(error.acceleration_error), float(error.jerk / error.jerk_truth), 100 * missing,
    )  # fmt: skip


def _unseen(config: Experiment) -> Table:
    """Distance to confident detections of each view from landmarks found in the other three."""
    real = balancing(config.data)
    apart: dict[str, list[Tensor]] = {}
    for view in range(real.cameras.views):
        others = [v for v in range(real.cameras.views) if v != view]
        sure = real.detections.confidence2d[:, view] > CONFIDENT
        for method, found in _methods(real, others, config):
            pixels = real.cameras.select([view]).project(found)[:, 0]
            away = (pixels - real.detections.joints2d[:, view]).norm(dim=-1)
            apart.setdefault(method, []).append(away[sure & away.isfinite()])
    rows = []
    for method, parts in apart.items():
        medians = [float(part.median()) for part in parts]
        whole = torch.cat(parts)
        rows.append((method, *medians, float(np.mean(medians)), float(whole.quantile(0.9))))
    columns = ("method", *real.rig.names, "mean of medians", "90 %")
    return Table("a real man: detections of a view from the other three, px", columns,
                 tuple(rows), 1)  # fmt: skip


def _alone(config: Experiment) -> Table:
    """PA-MPJPE and acceleration about the root of videos alone."""
    views = (0, 1, 2, 3) if config.real else ()
    rows = []
    for video in videos(Alone(data=config.data, sequences=config.alone, views=views)):
        raw = blazepose(video)
        with tempfile.TemporaryDirectory() as scratch:
            solved, _ = captured(Alone(data=config.data), video, None, Path(scratch) / "out")
        for method, found in (
            ("BlazePose world landmarks", raw),
            ("the same, Butterworth", low_pass(raw, video.rate)),
            ("perfcap", solved),
        ):
            frames = min(len(found), len(video.truth))
            found, truth = (_about_root(p[:frames].double()) for p in (found, video.truth))
            error = joint_errors(_turned(found, truth), truth, video.rate, partial=True)
            values = error.mpjpe_similarity, error.acceleration_error, error.jerk / error.jerk_truth
            rows.append((video.name, method, *(float(value) for value in values)))
    columns = ("video", "method", "PA-MPJPE mm", "accel", "jerk ratio")
    return Table("one view, the video alone", columns, tuple(rows), 1)


def blazepose(video: Video) -> Tensor:
    """World landmarks of the shipped network, (F, 16, 3) m, in the axes of the camera.

    MoveNet follows the person and cuts BlazePose's crops, as MediaPipe's tracker would; without,
    errors of the rendered people are 97 and 242 mm.
    """
    clip = Clip.open(video.path)
    rig = assumed_rig(clip)
    networks = (OnnxDetector(find_model(name, DETECTORS)) for name in ("thunder", "blazepose"))
    found = detect_clip(clip, Detecting(tuple(networks), poses=True), rig.cameras)
    assert found.joints3d is not None
    joints = torch.where(found.trusted3d[..., None, None], found.joints3d, torch.nan)
    return joints[:, 0].double()


def _turned(found: Tensor, truth: Tensor) -> Tensor:
    """A clip (F, 16, 3) under the one similarity that brings it nearest to the truth."""
    sure = (found.isfinite() & truth.isfinite()).all(-1)
    turn = procrustes(found[sure], truth[sure])
    return turn.apply(found)


def _about_root(points: Tensor) -> Tensor:
    return points - 0.5 * (points[:, 8:9] + points[:, 12:13])


if __name__ == "__main__":
    report.main(run, Experiment, "peers")
