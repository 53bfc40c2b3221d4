"""Recovery of a known motion of perfcap's own skeleton from exact detections in one view."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import report
import torch
from report import Report, Table
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.detect.detections import Detections
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import compose_rotvec, rotvec_to_matrix
from perfcap.io.actor import load_actor
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.presets import CaptureConfig

# m of the landmarks a radian: an angle that moves them less cannot be told from them
_SEEN = 0.003
_OPEN = 1e-4  # share of an angle in directions that are not seen
_RATE = 30.0
_COLUMNS = (
    "settings", "angles", "observable, mean", "observable, max", "all, mean", "joints, mean",
    "joints, max",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    actor: str = "sam"
    """Name or file of the actor."""
    frames: int = 120
    """At 30 a second; the person turns once around in them."""
    distance: float = 4.5
    """From the camera, metres."""
    seed: int = 0
    """Of the motion."""


def exact_settings(trajectory: float = 0.01) -> PoseConfig:
    """For detections without noise: hardly any preference for the smooth and the neutral.

    Robust kernels stay. They do not bias an exact fit, and quadratic ones lead limbs that start
    at rest into wrong minima; a trace of the trajectory prior takes a frame out of what is left.
    """
    base = PoseConfig(max_steps=200, initial_steps=100, tolerance=1e-6, clean=0.0)
    return replace(
        base,
        trajectory=replace(base.trajectory, weight=trajectory),
        prior=replace(base.prior, weight=1e-5),
    )


def run(config: Experiment) -> Report:
    """Make the motion, project it, capture it, compare."""
    actor = load_actor(config.actor)
    truth = smooth_motion(actor.skeleton, config.frames, torch.Generator().manual_seed(config.seed))
    camera = front_camera(config.distance)
    detections = observe(actor, camera, truth)
    seen = observable(actor.skeleton, truth)
    variants = {
        "prior 1 %": exact_settings(0.01),
        "prior 0.1 %": exact_settings(0.001),
        "default": PoseConfig(),
    }
    rows = []
    for name, settings in variants.items():
        result = capture(actor, camera, detections, _RATE, CaptureConfig(settings))
        wrong = torch.rad2deg((result.motion.angles - truth.angles).abs())
        apart = 1000 * (result.joints() - actor.joints(truth)).norm(dim=-1)
        values = (
            wrong[:, seen].mean(),
            wrong[:, seen].max(),
            wrong.mean(),
            apart.mean(),
            apart.max(),
        )
        rows.append((name, int(seen.sum()), *(float(v) for v in values)))
    hidden = [n for n, s in zip(actor.skeleton.angle_names, seen, strict=True) if not s]
    return Report(
        (Table("own skeleton, exact detections; degrees and mm", _COLUMNS, tuple(rows), 4),),
        (f"Not observable from the 16 landmarks, and left out: {', '.join(hidden)}.",),
    )


def smooth_motion(skeleton: Skeleton, frames: int, random: torch.Generator) -> Motion:
    """Swinging angles well inside the limits, a wandering root, and one full turn."""
    time = torch.linspace(0, 1, frames, dtype=torch.float64)[:, None]
    lower, upper = skeleton.lower, skeleton.upper

    def swing(size: int) -> Tensor:
        phase = 2 * math.pi * torch.rand(3, size, generator=random, dtype=torch.float64)
        speed = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)[:, None]
        return torch.sin(2 * math.pi * speed * time[..., None] + phase).mean(-2)

    angles = 0.5 * (lower + upper) + 0.4 * (upper - lower) * swing(len(lower))
    turn = 2 * math.pi * time * torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    rotation = compose_rotvec(turn, 0.2 * swing(3))
    return Motion(skeleton.rest_positions[0] + 0.3 * swing(3), rotation, angles)


def front_camera(distance: float) -> Camera:
    """A level camera at the height of the hips."""
    rotation = torch.diag(torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64))
    rotation = rotation @ rotvec_to_matrix(torch.tensor([0.1, 0.0, 0.0], dtype=torch.float64))
    away = torch.tensor([0.0, 0.0, distance], dtype=torch.float64)
    centre = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    intrinsics = torch.tensor([[1200.0, 0, 319.5], [0, 1200.0, 319.5], [0, 0, 1]]).double()
    return Camera(intrinsics[None], rotation[None], (away - rotation @ centre)[None])


def observe(actor: Actor, camera: Camera, motion: Motion) -> Detections:
    """Exact projections and exact 3D joints relative to the root."""
    local = camera.to_camera(actor.joints(motion))
    pixels = camera.project_camera(local)
    return Detections.from_joints(
        pixels, torch.ones_like(pixels[..., 0]), local - mid_hip(local).unsqueeze(-2)
    )


def observable(skeleton: Skeleton, motion: Motion) -> Tensor:
    """Angles that the landmarks determine in every frame, (A,), bool.

    An angle is open where some direction of all unknowns moves no landmark and moves it.
    """
    _, jacobian, _ = skeleton.linearize(motion)
    _, size, directions = torch.linalg.svd(jacobian.flatten(-3, -2), full_matrices=True)
    size = torch.nn.functional.pad(size, (0, directions.shape[-1] - size.shape[-1]))
    still = (size < _SEEN)[..., None] * directions  # F D D
    open_share: Tensor = still[..., 6:].square().sum(-2).amax(0)
    return open_share < _OPEN


if __name__ == "__main__":
    report.main(run, Experiment, "own_skeleton")
