"""One capture of a sweep: a sequence, detections simulated anew for every seed, scores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch
from detection_noise import Noise, detect
from numpy.typing import NDArray
from recordings import Recording, demo, rendered
from surface_recordings import SurfaceTruth, images_of, silhouette_overlap
from sweep import Cell, Sweep
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.metrics import joint_errors
from perfcap.metrics.alignment import root_aligned
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.stage import Stage

MOTION_SCORES = ("PA-MPJPE", "root", "absolute", "accel", "jerk ratio", "worst frame")


@dataclass(frozen=True)
class MotionSweep(Sweep):
    """A sweep of captures without images."""

    frames: int = 0
    """Of each sequence, from its first; all when 0."""


@cache
def recording_of(config: Sweep, sequence: str, frames: int = 0) -> Recording:
    """A sequence, or its first frames."""
    found = demo() if sequence == "demo" else rendered(config.data, sequence)
    if not frames:
        return found
    span = slice(0, frames)
    detections, truth = found.detections.frames(span), found.truth[span]
    rig = replace(found.rig, cameras=found.cameras.frames(span))
    return replace(found, rig=rig, detections=detections, truth=truth)


def simulated(recording: Recording, seed: int, noise: Noise | None = None) -> Detections:
    """Detections of the true joints in one view by a simulated network."""
    camera = recording.cameras
    local = camera.to_camera(recording.truth)[:, 0].double().numpy()

    def project(points: NDArray[np.float64]) -> NDArray[np.float64]:
        pixels: NDArray[np.float64] = camera.project_camera(torch.tensor(points)[:, None])[
            :, 0
        ].numpy()
        return pixels

    rng = np.random.default_rng([seed, len(local)])
    joints2d, confidence, joints3d = (
        torch.tensor(found)[:, None] for found in detect(local, rng, project, noise)
    )
    return Detections.from_joints(joints2d, confidence, joints3d)


def track(
    recording: Recording,
    detections: Detections,
    config: CaptureConfig | None = None,
    cameras: Camera | None = None,
    until: Stage = Stage.TRACK_MOTION,
) -> Performance:
    """The motion of a sequence."""
    cameras = cameras or recording.cameras
    return capture(
        recording.actor, cameras, detections, recording.rate, config, until=until, workers=1
    )


def motion_scores(recording: Recording, joints: Tensor) -> Mapping[str, float]:
    """Errors of joints (F, 16, 3), mm and mm/frame^2."""
    errors = joint_errors(joints, recording.truth, recording.rate)
    apart = (root_aligned(joints) - root_aligned(recording.truth)).norm(dim=-1).mean(-1)
    values = (
        errors.mpjpe_similarity, errors.mpjpe_root, errors.mpjpe, errors.acceleration_error,
        errors.jerk / errors.jerk_truth, 1000 * apart.max(),
    )  # fmt: skip
    return {name: float(value) for name, value in zip(MOTION_SCORES, values, strict=True)}


def tracked(
    config: MotionSweep, cell: Cell, settings: CaptureConfig, noise: Noise | None = None
) -> Mapping[str, float]:
    """Scores of a motion from simulated detections."""
    recording = recording_of(config, cell.sequence, config.frames)
    found = track(recording, simulated(recording, cell.seed, noise), settings)
    return motion_scores(recording, found.joints())


def whole(recording: Recording, detections: Detections, settings: CaptureConfig) -> Performance:
    """A capture with images, of as many frames as there are detections."""
    images = images_of(recording)
    span = slice(0, detections.frame_count)
    return capture(
        recording.actor,
        recording.cameras.frames(span),
        detections,
        recording.rate,
        settings,
        images=images.frames(span),
        workers=1,
    )


def surface_scores(recording: Recording, found: Performance, every: int) -> Mapping[str, float]:
    """Overlap with true masks, %, and surface error after the mean offset, mm, of some frames."""
    truth, images, surface = SurfaceTruth.read(recording), images_of(recording), found.shown
    frames = range(0, found.frames, every)
    overlaps = [silhouette_overlap(recording, images, surface, f) for f in frames]
    errors = [truth.error(surface[f : f + 1][0].double().numpy(), f).surface for f in frames]
    return {"IoU %": 100 * float(np.mean(overlaps)), "surface mm": float(np.mean(errors))}
