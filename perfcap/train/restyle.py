"""Recorded motion as other people might have moved: limbs of one clip on another, held otherwise.

A few people do few things in a few ways; a network learns them by heart. Arms or a whole upper body
from another clip, and limbs turned a little in the axes of the pelvis, make motion that nobody
recorded, though no frame is much less natural than before.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Generator, Tensor

from perfcap.actor.anatomy import JOINTS
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.train.config import LiftingData

PELVIS, SPINE = JOINTS.index("pelvis"), JOINTS.index("spine")
_TRUNK = {"head", "neck"}
_ARMS = {"shoulder", "elbow", "wrist"}


def _bones(parts: set[str], sides: str = "lr") -> list[int]:
    """Bones that end at these parts, by their landmark."""
    return [
        i
        for i, name in enumerate(LANDMARKS)
        if name.split("_")[0] in parts or (name[0] in sides and name[2:] in parts)
    ]


_ARM_BONES, _UPPER_BONES = _bones(_ARMS), _bones(_ARMS | _TRUNK)
_CHAINS = [  # bones that are turned together
    (side, chain)
    for side in "lr"
    for chain in ({"elbow", "wrist"}, {"wrist"}, {"knee", "ankle", "toe"}, {"ankle", "toe"})
]


@dataclass(frozen=True)
class Track:
    """Stretches of motion.

    Attributes:
        bones: vectors to landmarks from their parents, (N, F, 16, 3).
        pelvis: how it is turned in the world, (N, F, 3, 3).
        spine: likewise.
    """

    bones: Tensor
    pelvis: Tensor
    spine: Tensor


def restyled(track: Track, other: Track, data: LiftingData, generator: Generator) -> Tensor:
    """Bones (N, F, 16, 3) of tracks, some with limbs of others, all held a little otherwise.

    Args:
        track: who moves.
        other: whose limbs they may have.
        data: how often, and how much.
        generator: of everything random.
    """
    bones = _recombined(track, other, data.recombined, generator)
    return _loosened(bones, track.pelvis, data, generator)


def _recombined(track: Track, other: Track, share: float, generator: Generator) -> Tensor:
    """Bones with the arms of others, in the axes of the spine, or all above the pelvis, in its."""
    kind = torch.rand(len(track.bones), generator=generator)[:, None, None, None] / max(share, 1e-9)
    bones = track.bones
    for low, rows, own, theirs in (
        (0.0, _ARM_BONES, track.spine, other.spine),
        (0.5, _UPPER_BONES, track.pelvis, other.pelvis),
    ):
        moved = other.bones @ (own @ theirs.mT).mT
        chosen = torch.zeros(len(LANDMARKS), 1, dtype=torch.bool)
        chosen[rows] = True
        bones = torch.where(chosen & (kind >= low) & (kind < low + 0.5), moved, bones)
    return bones


def _loosened(bones: Tensor, pelvis: Tensor, data: LiftingData, generator: Generator) -> Tensor:
    """Bones with limbs turned in the axes of the pelvis, by as much all the while."""
    bones = bones.clone()
    for side, parts in _CHAINS:
        swing = data.swung if "wrist" in parts else 1.0
        vector = torch.randn(len(bones), 3, generator=generator)
        turn = rotvec_to_matrix(vector * torch.tensor(data.loosened * swing).deg2rad())
        local = pelvis @ turn[:, None] @ pelvis.mT
        rows = _bones(parts, side)
        bones[:, :, rows] = bones[:, :, rows] @ local.mT
    return bones
