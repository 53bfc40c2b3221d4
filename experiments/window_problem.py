"""The pose problem of experiments: simulated detections of one person in front of one camera.

Motions are windows of CMU clips when that library lies at hand, retargeted to one subject's bones
so that they make a batch, and smooth random motions of perfcap's own skeleton otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import cmu
import numpy as np
import report
import torch
from detection_noise import detect
from torch import Tensor
from torch.nn import Module
from window_motion import clip_landmarks, default_skeleton, random_landmarks

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.objective import (
    FrameProblem,
    angle_bounds,
    pose_objective,
    trajectory_prior,
)
from perfcap.pipeline.prepare import prepare
from perfcap.solve import Bounds, Objective

LIBRARY = report.DATA / "mocap_cmu_library"
Arrays = tuple[np.ndarray, np.ndarray, np.ndarray]
Detect = Callable[[np.ndarray, np.random.Generator, Callable[[np.ndarray], np.ndarray]], Arrays]
# walking, running, kicking, punching, jumping, climbing, dancing, dribbling
_CLIPS = ("07_01", "02_03", "05_02", "02_05", "02_04", "01_03", "05_10", "06_11")
_FOCAL, _CENTRE, _SIZE = 1220.0, 319.5, 640  # px


class _BareActor(Actor):
    def __init__(self, skeleton: Skeleton) -> None:
        Module.__init__(self)  # no template, no skin
        self.skeleton = skeleton

    def joints(self, motion: Motion) -> Tensor:
        """Landmarks in the world, (*b, F, 16, 3), metres."""
        joints: Tensor = self.landmarks(motion)
        return joints


def bare_actor(skeleton: Skeleton) -> Actor:
    """An actor without a surface: all that pose energies ask for."""
    return _BareActor(skeleton)


@dataclass(frozen=True)
class Sequence:
    """A person, a camera, what a detector says, and the truth (F, 16, 3) in metres."""

    name: str
    actor: Actor
    cameras: Camera
    detections: Detections
    landmarks: Tensor


def windows(
    count: int = 8,
    frames: int = 50,
    seed: int = 0,
    library: Path = LIBRARY,
    detector: Detect = detect,
) -> list[Sequence]:
    """Windows of different motions of the same person, seen from different sides.

    Args:
        count: of windows, at most 8 when the library is there.
        frames: of a window, at 30 Hz.
        seed: of headings and noise.
        library: folder of the CMU motions.
        detector: ``detect`` with swaps, outliers and depth flips, or ``gaussian``.
    """
    rng = np.random.default_rng(seed)
    if library.is_dir():
        actor = bare_actor(cmu.skeleton(library, "01_01"))
        truths = {
            clip: clip_landmarks(actor.skeleton, library, clip, frames) for clip in _CLIPS[:count]
        }
    else:
        actor = bare_actor(default_skeleton())
        truths = {
            f"random {i}": random_landmarks(actor.skeleton, frames, rng) for i in range(count)
        }
    return [observe(name, actor, points, rng, detector) for name, points in truths.items()]


def gaussian(
    truth: np.ndarray, rng: np.random.Generator, project: Callable[[np.ndarray], np.ndarray]
) -> Arrays:
    """Independent errors: 1 % of the person's height in the image, 3 cm relative to the root."""
    pixels = project(truth)
    height = np.median(np.ptp(pixels[..., 1], axis=1))
    joints2d = pixels + 0.01 * height * rng.normal(size=pixels.shape)
    root = 0.5 * (truth[:, 8:9] + truth[:, 12:13])
    return joints2d, np.ones(pixels.shape[:2]), truth - root + 0.03 * rng.normal(size=truth.shape)


def observe(
    name: str,
    actor: Actor,
    landmarks: Tensor,
    rng: np.random.Generator,
    detector: Detect = detect,
) -> Sequence:
    """Put a camera where it sees all of a motion (F, 16, 3), and simulate its detections."""
    low, high = landmarks.flatten(0, 1).amin(0), landmarks.flatten(0, 1).amax(0)
    centre = 0.5 * (low + high)
    distance = max(4.0, 4.3 * float((landmarks - centre).norm(dim=-1).max()))
    heading, tilt = rng.uniform(0, 2 * math.pi), rng.uniform(-0.05, 0.25)
    rotation = torch.diag(landmarks.new_tensor([1.0, -1.0, -1.0]))
    for turn in ((tilt, 0.0, 0.0), (0.0, heading, 0.0)):
        rotation = rotation @ rotvec_to_matrix(landmarks.new_tensor(turn))
    shift = landmarks.new_tensor([0.0, 0.0, distance]) - rotation @ centre
    intrinsics = landmarks.new_tensor([[_FOCAL, 0, _CENTRE], [0, _FOCAL, _CENTRE], [0, 0, 1]])
    camera = Camera(intrinsics[None], rotation[None], shift[None], size=((_SIZE, _SIZE),))

    def project(local: np.ndarray) -> np.ndarray:
        pixels: np.ndarray = camera.project_camera(torch.tensor(local)[:, None])[:, 0].numpy()
        return pixels

    local = camera.to_camera(landmarks)[:, 0].numpy()
    seen = (torch.tensor(part)[:, None] for part in detector(local, rng, project))
    return Sequence(name, actor, camera, Detections.from_joints(*seen), landmarks)


@dataclass(frozen=True)
class Problem:
    """What the pipeline would solve for a window at 30 Hz, and where it would start."""

    sequence: Sequence  # with prepared detections
    config: PoseConfig
    unit: Tensor
    initial: Motion
    objective: Objective
    bounds: Bounds

    @classmethod
    def of(cls, sequence: Sequence, config: PoseConfig) -> Self:
        """The problem of a window, in the type of its detections."""
        frames = FrameProblem.of(sequence.actor, sequence.cameras, sequence.detections, config)
        prepared = prepare(frames)
        initial, _ = initialize(prepared)
        sequence = replace(sequence, detections=prepared.detections)
        return cls._build(sequence, config, frames.pixel_unit, initial)

    def single(self) -> Self:
        """The same in float32."""
        like, sequence = torch.zeros(0), self.sequence
        rounded = replace(
            sequence,
            actor=bare_actor(Skeleton(sequence.actor.skeleton.rig).to(like)),
            cameras=sequence.cameras.to(like),
            detections=sequence.detections.to(like),
        )
        return self._build(rounded, self.config, self.unit.to(like), self.initial.to(like))

    def frame(self, index: int) -> Objective:
        """The objective of one frame alone."""
        at = slice(index, index + 1)
        return _objective(self.sequence, self.config, self.unit, at)

    @classmethod
    def _build(cls, sequence: Sequence, config: PoseConfig, unit: Tensor, initial: Motion) -> Self:
        objective = _objective(sequence, config, unit, slice(None))
        return cls(sequence, config, unit, initial, objective, angle_bounds(sequence.actor))


def _objective(sequence: Sequence, config: PoseConfig, unit: Tensor, at: slice) -> Objective:
    detections = sequence.detections
    prior = trajectory_prior(config.trajectory, detections.frame_count, 30.0)
    frames = detections.frames(at)
    return pose_objective(sequence.actor, sequence.cameras, frames, config, unit, prior)
