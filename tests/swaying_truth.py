"""Joints of a person who sways and turns, and what is said of a truth that was spoilt."""

from __future__ import annotations

import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.metrics import mismatches

FRAMES = 60


def swaying() -> Tensor:
    """Joints (60, 16, 3), metres."""
    take = make_take(FRAMES, turns=0.2)
    return take.actor.joints(take.truth)


def trembling(joints: Tensor) -> Tensor:
    """Noise without unit of the same shape, always the same."""
    return torch.randn(joints.shape, generator=torch.Generator().manual_seed(0)).to(joints)


def told(estimate: Tensor, truth: Tensor) -> tuple[str, ...]:
    """Sentences about a truth whose frames are 100 to 159."""
    known = torch.ones(truth.shape[:-1], dtype=torch.bool)
    order, frames = LANDMARKS16.mirrored(), range(100, 100 + FRAMES)
    return mismatches(estimate, truth, known, order, frames=frames, joints=LANDMARKS)
