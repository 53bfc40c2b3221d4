"""The refinement layer behind three noisy estimators, on rendered and on captured motion.

Every estimator is the truth with errors of its own: places of joints in camera axes, with white and
with slow noise; the 2D joints and root-relative 3D joints of a simulated detector, with swaps,
outliers and depth flips; 2D joints of such a detector in three views. The layer knows the bone
lengths, as an actor, and no truth. A clip is worse when its joint error or its acceleration error
is larger after refinement.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cmu
import numpy as np
import report
import torch
from detection_noise import detect
from recordings import rendered
from report import Report, Table
from torch import Tensor
from window_problem import bare_actor

from perfcap.actor.actor import Actor
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.geometry.triangulation import translation_from_plane, triangulate
from perfcap.metrics import joint_errors
from perfcap.pipeline import PoseRefiner

_FOCAL, _SIZE = 1220.0, 640  # px
_RATE = 30.0
_COLUMNS = (
    "clips", "estimator", "joint error before", "after", "lower, %", "worst clip, %",
    "acceleration before", "after ", "lower, % ", "worst clip, % ", "worse clips", "ms a frame",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    clips: int = 1000
    """Of the CMU library, at most."""
    frames: int = 10_000
    """Of a clip, at most, at 30 Hz."""
    white: float = 0.04
    """Deviation of the error that is new in every frame, metres an axis."""
    slow: float = 0.01
    """Deviation of the error that lasts about ten frames."""
    seed: int = 0
    """Of noise and cameras."""
    only: str = ""
    """Estimators whose name contains this; all when empty."""


@dataclass(frozen=True)
class Clip:
    """A person, three views, and the truth (F, 16, 3) in metres."""

    name: str
    actor: Actor
    cameras: Camera
    truth: Tensor


@dataclass(frozen=True)
class Guess:
    """What an estimator says: inputs of the layer, and its own joints in the world."""

    cameras: Camera
    inputs: dict[str, Tensor]
    joints: Tensor


@dataclass(frozen=True)
class Score:
    """Errors before and after, mm and mm/frame^2, and CPU seconds a frame."""

    joints: tuple[float, float]
    acceleration: tuple[float, float]
    seconds: float

    @property
    def worse(self) -> bool:
        """Whether either error grew."""
        return self.joints[1] > self.joints[0] or self.acceleration[1] > self.acceleration[0]


def run(config: Experiment) -> Report:
    """Score every estimator on every clip."""
    torch.set_num_threads(1)
    sets = {
        "rendered": list(_rendered(config)),
        "CMU": list(library(config)),
    }
    estimators: dict[str, Callable[[Clip, np.random.Generator, Experiment], Guess]] = {
        "places of joints": _places,
        "places, a quarter of the noise": _near_places,
        "2D and 3D joints, one view": one_view,
        "2D joints, three views": _three_views,
    }
    rows, worst = [], []
    for label, clips in sets.items():
        for name, estimator in estimators.items():
            if config.only not in name:
                continue
            scores = [_score(clip, estimator, config, i) for i, clip in enumerate(clips)]
            rows.append(_row(f"{label}, {len(clips)}", name, scores))
            worse = [c.name for c, s in zip(clips, scores, strict=True) if s.worse]
            worst += [f"worse, {label}, {name}: {', '.join(worse)}"] if worse else []
    notes = (
        "Joint error: MPJPE in the world, mm; of one view with roots aligned, since its detector "
        "does not say how far away the person is. Acceleration error: mm/frame². Medians over "
        "clips; the worst clip is the one that gains least.",
        *worst,
    )
    return Report((Table("before and after refinement", _COLUMNS, tuple(rows)),), notes)


def _rendered(config: Experiment) -> Iterator[Clip]:
    for name in ("dev_tight", "dev_skirt"):
        recording = rendered(config.data, name)
        truth = recording.truth[: config.frames]
        yield Clip(name, recording.actor, _around(truth, config.seed), truth)


def library(config: Experiment) -> Iterator[Clip]:
    root = report.data_folder(config.data, "mocap_cmu_library")
    for index, name in enumerate(cmu.clip_names(root)[: config.clips]):
        truth = cmu.landmarks(root, name)[: config.frames]
        actor = bare_actor(cmu.skeleton(root, name))
        yield Clip(name, actor, _around(truth, config.seed + index), truth)


def _around(truth: Tensor, seed: int) -> Camera:
    """Three views, a third of a turn apart, from which the whole motion is seen."""
    rng = np.random.default_rng(seed)
    low, high = truth.flatten(0, 1).amin(0), truth.flatten(0, 1).amax(0)
    centre = 0.5 * (low + high)
    distance = max(4.0, 4.3 * float((truth - centre).norm(dim=-1).max()))
    heading, tilt = rng.uniform(0, 2 * math.pi), rng.uniform(-0.05, 0.25)
    flip = torch.diag(truth.new_tensor([1.0, -1.0, -1.0]))
    lean = flip @ rotvec_to_matrix(truth.new_tensor([tilt, 0.0, 0.0]))
    turns = [rotvec_to_matrix(truth.new_tensor([0, heading + k * 2.1, 0])) for k in range(3)]
    rotation = torch.stack([lean @ turn for turn in turns])
    shift = truth.new_tensor([0.0, 0.0, distance]) - rotation @ centre
    middle = 0.5 * (_SIZE - 1)
    lens = truth.new_tensor([[_FOCAL, 0, middle], [0, _FOCAL, middle], [0, 0, 1]])
    return Camera(lens.expand(3, 3, 3), rotation, shift, size=((_SIZE, _SIZE),) * 3)


def _places(clip: Clip, rng: np.random.Generator, config: Experiment) -> Guess:
    """A network that puts joints into space."""
    camera = clip.cameras.select([0])
    noise = config.white * rng.normal(size=clip.truth.shape)
    drift = np.zeros(clip.truth.shape)
    keep = 0.9
    drift[0] = rng.normal(size=drift.shape[1:])
    for frame in range(1, len(drift)):
        new = rng.normal(size=drift.shape[1:])
        drift[frame] = keep * drift[frame - 1] + math.sqrt(1 - keep**2) * new
    joints = clip.truth + torch.tensor(noise + config.slow * drift)
    return Guess(camera, {"joints3d": camera.to_camera(joints)}, joints)


def _near_places(clip: Clip, rng: np.random.Generator, config: Experiment) -> Guess:
    """The same, far better than any network is."""
    return _places(clip, rng, replace(config, white=0.25 * config.white, slow=0.25 * config.slow))


def one_view(clip: Clip, rng: np.random.Generator, config: Experiment) -> Guess:
    """A detector of 2D joints and of 3D joints relative to the root."""
    camera = clip.cameras.select([0])
    pixels, confidence, local = _detected(clip, camera, rng)
    plane = camera.to_plane(pixels)
    shift, _ = translation_from_plane(local, plane, confidence)
    placed = local + shift.nan_to_num(0).unsqueeze(-2)
    joints = ((placed - camera.translation.unsqueeze(-2)) @ camera.rotation)[:, 0]
    inputs = {"joints2d": pixels, "confidence2d": confidence, "joints3d": local}
    return Guess(camera, inputs, joints)


def _three_views(clip: Clip, rng: np.random.Generator, config: Experiment) -> Guess:
    """A detector of 2D joints in three views, robustly triangulated."""
    views = [_detected(clip, clip.cameras.select([view]), rng) for view in range(3)]
    pixels, confidence = (torch.cat(parts, 1) for parts in list(zip(*views, strict=True))[:2])
    joints, _ = triangulate(clip.cameras, clip.cameras.to_plane(pixels), confidence)
    return Guess(clip.cameras, {"joints2d": pixels, "confidence2d": confidence}, joints)


def _detected(
    clip: Clip, camera: Camera, rng: np.random.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Simulated detections of one view, (F, 1, 16, ...)."""

    def project(local: np.ndarray) -> np.ndarray:
        pixels: np.ndarray = camera.project_camera(torch.tensor(local)[:, None])[:, 0].numpy()
        return pixels

    local = camera.to_camera(clip.truth)[:, 0].numpy()
    pixels, confidence, joints = (torch.tensor(x)[:, None] for x in detect(local, rng, project))
    return pixels, confidence, joints


def _score(
    clip: Clip,
    estimator: Callable[[Clip, np.random.Generator, Experiment], Guess],
    config: Experiment,
    index: int,
) -> Score:
    guess = estimator(clip, np.random.default_rng([config.seed, index]), config)
    layer = PoseRefiner(clip.actor, rate=_RATE).eval()
    start = time.process_time()
    refined = layer(guess.cameras, **guess.inputs).joints
    seconds = (time.process_time() - start) / len(clip.truth)
    errors = [joint_errors(joints, clip.truth, _RATE) for joints in (guess.joints, refined)]
    aligned = "joints2d" in guess.inputs and guess.cameras.views == 1
    before, after = (float(e.mpjpe_root if aligned else e.mpjpe) for e in errors)
    if aligned:  # without the root, whose depth the detector does not know
        free = [joints - mid_hip(joints)[:, None] for joints in (guess.joints, refined, clip.truth)]
        errors = [joint_errors(joints, free[2], _RATE) for joints in free[:2]]
    first, second = (float(e.acceleration_error) for e in errors)
    return Score((before, after), (first, second), seconds)


def _row(label: str, name: str, scores: list[Score]) -> tuple[object, ...]:
    columns: list[object] = [label, name]
    for pairs in ([s.joints for s in scores], [s.acceleration for s in scores]):
        lower = [100 * (1 - after / before) for before, after in pairs]
        middle = (statistics.median(x) for x in zip(*pairs, strict=True))
        columns += [*middle, statistics.median(lower), min(lower)]
    worse = f"{sum(score.worse for score in scores)} of {len(scores)}"
    return *columns, worse, 1e3 * statistics.median(score.seconds for score in scores)


if __name__ == "__main__":
    report.main(run, Experiment, "pose_refiner")
