"""Motions to try solvers on: windows of CMU clips on one subject's bones, and random ones."""

from __future__ import annotations

from pathlib import Path

import cmu
import numpy as np
import torch
from torch import Tensor

from perfcap.actor.anatomy import human_rig
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Pose, Skeleton
from perfcap.detect.retarget import bone_vectors, mid_hip, retarget
from perfcap.temporal.subspace import dct_basis

# an adult in a T-pose: the left side and the middle, metres, y up, facing +z
_REST = {
    "pelvis": (0, 0.98, 0), "spine": (0, 1.08, 0), "neck": (0, 1.48, 0), "head": (0, 1.56, 0),
    "head_top": (0, 1.76, 0), "shoulder": (0.18, 1.42, 0), "elbow": (0.46, 1.42, 0),
    "wrist": (0.71, 1.42, 0), "hip": (0.10, 0.94, 0), "knee": (0.10, 0.51, 0.01),
    "ankle": (0.10, 0.09, 0), "toe": (0.10, 0.03, 0.16),
}  # fmt: skip
_SIDED = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe")


def default_skeleton() -> Skeleton:
    """An average adult."""
    rest = {name: torch.tensor(place).double() for name, place in _REST.items()}
    for name in _SIDED:
        place = rest.pop(name)
        rest[f"l_{name}"], rest[f"r_{name}"] = place, place * torch.tensor([-1.0, 1.0, 1.0])
    return Skeleton(human_rig(rest))


def random_landmarks(skeleton: Skeleton, frames: int, rng: np.random.Generator) -> Tensor:
    """Landmarks of a smooth random motion within the limits, (F, 16, 3), metres."""
    rank = max(1, round(0.14 * frames))
    basis = dct_basis(frames, rank, dtype=torch.float64)
    spread = (frames / rank) ** 0.5  # so that components of variance one move with variance one

    def curve(size: int) -> Tensor:
        components = torch.tensor(rng.normal(size=(rank, size)))
        moved: Tensor = (spread * basis.mT) @ components
        return moved

    lower, upper = skeleton.lower, skeleton.upper
    centre = 0.2 * (lower + upper)
    angles = (centre + 0.15 * (upper - lower) * curve(len(lower))).clamp(lower, upper)
    upright = torch.tensor([0.15, 0.6, 0.15], dtype=torch.float64)
    pose: Pose = skeleton(Motion(0.15 * curve(3), upright * curve(3), angles))
    return pose.landmarks


def clip_landmarks(skeleton: Skeleton, library: Path, clip: str, frames: int) -> Tensor:
    """The middle of a clip with the bones of a skeleton, (F, 16, 3)."""
    points = cmu.landmarks(library, clip, step=1)
    span = min(len(points), 2 * frames)
    start = (len(points) - span) // 2
    points = points[start : start + span]
    points = points[torch.linspace(0, span - 1, frames).round().long()]
    lengths = bone_vectors(skeleton.rest_landmarks).norm(dim=-1)
    return retarget(points, lengths) + mid_hip(points)[:, None]
