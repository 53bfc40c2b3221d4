"""A prior that follows the evidence: recorded motion, as fast as it was and half again as fast.

Clips of the CMU library on which the prior was not chosen, though limits of angles and their steep
ends were with these clips in view, on the person's own bones, seen by one to
eight views of a simulated detector: solved once, with the stated prior and weights, and twice, with
a prior and weights from the first solve. Robust triangulation needs two views. The most active
stretch of a clip counts; where a landmark is faster than 200 m/s^2 the capture itself failed, and
the stretch is another one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cmu
import numpy as np
import report
import torch
from detection_noise import Noise, detect
from report import Report, Table
from torch import Tensor
from window_problem import bare_actor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.geometry.triangulation import triangulate
from perfcap.metrics import joint_errors
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.config import EvidenceConfig, PoseConfig
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.move import with_known_poses
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import prepare, relaxed
from perfcap.pipeline.track_twice import track_twice

# the prior was chosen on the other clips, and the rendered sequences were made from some of these
HELD_OUT = (
    "01_06", "01_09", "01_14", "02_05", "05_03", "05_17", "05_20",
    "06_01", "06_07", "06_11", "07_01", "07_03", "07_06", "07_08",
)  # fmt: skip
_RATE, _FOCAL, _SIZE = 30.0, 1220.0, 640
_GLITCH, _FAST = 200.0, 40.0  # m/s^2
_METHODS = ("triangulation", "once", "twice")


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    views: tuple[int, ...] = (1, 2, 4, 6, 8)
    """Numbers of views."""
    clips: int = 14
    """Of the library, at most."""
    frames: int = 100
    """Of a clip, at most."""
    seed: int = 0
    """Of cameras and noise."""
    exact: bool = False
    """Detections without errors."""


@dataclass(frozen=True)
class Take:
    """A clip and what detectors say of it."""

    name: str
    actor: Actor
    cameras: Camera
    detections: Detections
    truth: Tensor

    @property
    def fast(self) -> float:
        """Share of the frames in which a landmark is faster than 40 m/s^2."""
        return float((_acceleration(self.truth) > _FAST).any(-1).double().mean())


Scores = tuple[float, float, float]


def run(config: Experiment) -> Report:
    """A table of every number of views, and one of the fast clips in one view."""
    torch.set_num_threads(1)
    rows, single = [], []
    for views in config.views:
        found = [(take, _scores(take)) for take in takes(config, views)]
        rows += [_row(views, method, [each for _, each in found]) for method in _methods(views)]
        if views == 1:
            single = [_fast_row(*each) for each in found if each[0].fast > 0.1]
    columns = (
        "views", "method", "error, median", "10 %", "90 %", "accel", "accel 90 %", "jerk ratio",
        "best of the three",
    )  # fmt: skip
    fast = (
        "clip", "frames above 40 m/s², %", "error once", "twice", "accel once", "twice ",
        "jerk once", "twice  ",
    )  # fmt: skip
    notes = (
        "Error: of one view after a similarity, root-free acceleration; of several in the world. "
        "Millimetres and mm/frame²; medians over clips and quantiles, jerk over the truth's.",
    )
    tables = [Table("recorded motion, none of which chose the prior", columns, tuple(rows), 2)]
    if single:
        tables.append(Table("one view of fast motion", fast, tuple(single), 2))
    return Report(tuple(tables), notes)


def takes(config: Experiment, views: int, clips: Sequence[str] = HELD_OUT) -> Iterator[Take]:
    """Every clip at both speeds."""
    root = report.data_folder(config.data, "mocap_cmu_library")
    for number, name in enumerate(clips[: config.clips]):
        actor = bare_actor(cmu.skeleton(root, name))
        for step in (2, 3):
            truth = active(cmu.landmarks(root, name, step), config.frames)
            rng = np.random.default_rng([config.seed, number, step, views])
            cameras = around(truth, views, rng)
            noise = Noise(0, 0, 0, 0, 0) if config.exact else None
            seen = observed(truth, cameras, rng, noise)
            yield Take(f"{name} x {step / 2:g}", actor, cameras, seen, truth)


def active(points: Tensor, frames: int) -> Tensor:
    """The most active stretch (F, 16, 3) of a clip in which nothing jumps."""
    if len(points) <= frames:
        return points
    size = _acceleration(points)
    activity = size.clamp(max=120).mean(-1) - 100 * (size.amax(-1) > _GLITCH)
    start = int(activity.unfold(0, frames - 2, 1).mean(-1).argmax())
    return points[start : start + frames]


def _acceleration(points: Tensor) -> Tensor:
    """(F - 2, 16), m/s^2."""
    size: Tensor = points.diff(n=2, dim=0).norm(dim=-1)
    return size * _RATE**2


def around(truth: Tensor, views: int, rng: np.random.Generator) -> Camera:
    """Views from all around that see a whole motion."""
    low, high = truth.flatten(0, 1).amin(0), truth.flatten(0, 1).amax(0)
    centre = 0.5 * (low + high)
    distance = max(4.0, 4.3 * float((truth - centre).norm(dim=-1).max()))
    flip = torch.diag(truth.new_tensor([1.0, -1.0, -1.0]))
    heading, turned = rng.uniform(0, 2 * math.pi), []
    for view in range(views):
        yaw = heading + 2 * math.pi * view / views + rng.uniform(-0.2, 0.2)
        lean = rotvec_to_matrix(truth.new_tensor([rng.uniform(-0.05, 0.35), 0, 0]))
        turned.append(flip @ lean @ rotvec_to_matrix(truth.new_tensor([0, yaw, 0])))
    rotation = torch.stack(turned)
    shift = truth.new_tensor([0.0, 0.0, distance]) - rotation @ centre
    middle = 0.5 * (_SIZE - 1)
    lens = truth.new_tensor([[_FOCAL, 0, middle], [0, _FOCAL, middle], [0, 0, 1]])
    return Camera(lens.expand(views, 3, 3), rotation, shift, size=((_SIZE, _SIZE),) * views)


def observed(
    truth: Tensor, cameras: Camera, rng: np.random.Generator, noise: Noise | None
) -> Detections:
    """2D joints of every view; 3D joints as well where there is only one."""
    parts = []
    for view in range(cameras.views):
        one = cameras.select([view])

        def project(local: np.ndarray, one: Camera = one) -> np.ndarray:
            pixels: np.ndarray = one.project_camera(torch.tensor(local)[:, None])[:, 0].numpy()
            return pixels

        local = one.to_camera(truth)[:, 0].numpy()
        parts.append([torch.tensor(x)[:, None] for x in detect(local, rng, project, noise)])
    pixels, confidence, joints = (torch.cat(each, 1) for each in zip(*parts, strict=True))
    return Detections.from_joints(pixels, confidence, joints if cameras.views == 1 else None)


def _methods(views: int) -> tuple[str, ...]:
    return _METHODS if views > 1 else _METHODS[1:]


def _scores(take: Take) -> dict[str, Scores]:
    """Error, acceleration error and jerk ratio by method."""
    found = {}
    once = replace(PoseConfig(), evidence=EvidenceConfig(enabled=False))
    for name, pose in (("once", once), ("twice", PoseConfig())):
        found[name] = tracked(take, pose)
    if take.cameras.views > 1:
        plane = take.cameras.to_plane(take.detections.joints2d)
        points, _ = triangulate(take.cameras, plane, take.detections.confidence2d)
        found["triangulation"] = points
    return {name: _score(joints, take) for name, joints in found.items()}


def tracked(take: Take, config: PoseConfig) -> Tensor:
    """Joints (F, 16, 3) of the motion, as a capture without images finds it."""
    frames = FrameProblem.of(take.actor, take.cameras, take.detections, config)
    prepared = prepare(relaxed(frames))
    initial, _ = initialize(prepared)
    problem = with_known_poses(ClipProblem.of(prepared.problem, _RATE))
    motion, _, _ = track_twice(problem, initial)
    return take.actor.joints(motion)


def _score(joints: Tensor, take: Take) -> Scores:
    error = joint_errors(joints, take.truth, _RATE)
    jerk = float(error.jerk / error.jerk_truth)
    if take.cameras.views > 1:
        return float(error.mpjpe), float(error.acceleration_error), jerk
    free = [points - 0.5 * (points[:, 8:9] + points[:, 12:13]) for points in (joints, take.truth)]
    relative = joint_errors(free[0], free[1], _RATE)
    return float(error.mpjpe_similarity), float(relative.acceleration_error), jerk


def _row(views: int, method: str, scores: list[dict[str, Scores]]) -> tuple[object, ...]:
    error, acceleration, jerk = (
        np.array(x) for x in zip(*(s[method] for s in scores), strict=True)
    )
    best = sum(min(each, key=lambda name: each[name][0]) == method for each in scores)
    return (
        views, method, *np.nanquantile(error, (0.5, 0.1, 0.9)).tolist(),
        *np.nanquantile(acceleration, (0.5, 0.9)).tolist(), float(np.nanmedian(jerk)),
        f"{best} of {len(scores)}",
    )  # fmt: skip


def _fast_row(take: Take, scores: dict[str, Scores]) -> tuple[object, ...]:
    pairs = zip(scores["once"], scores["twice"], strict=True)
    return take.name, 100 * take.fast, *(value for pair in pairs for value in pair)


if __name__ == "__main__":
    report.main(run, Experiment, "fast_motion")
