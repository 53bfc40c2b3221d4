"""Joints that were not found and are stored as one place, such as 0, 0, 0."""

from __future__ import annotations

from collections import Counter

import torch
from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity

_FEWEST = 3  # joints at one place: a toe may be guessed to be at its ankle, and no other joint
_SHARE = 0.05  # of the frames
_PLACEHOLDERS = 3  # joints at one place in the corner


def examine_empty(subject: str, poses: Tensor) -> list[Finding]:
    """Joints of 3D poses that lie at one place to the last digit: those of people do not.

    Args:
        subject: of the finding.
        poses: landmarks (N, 16, 3) that are trusted.
    """
    if not len(poses):
        return []
    same = (poses[:, :, None] == poses[:, None]).all(-1).sum(-1)  # N 16: joints at its place
    empty = same.amax(-1) >= _FEWEST
    count = int(empty.sum())
    if count < max(1, _SHARE * len(poses)):
        return []
    most = int(torch.where(empty, same.amax(-1), 0).amax())
    what = (
        f"in {count} of {len(poses)} frames up to {most} of the 3D joints are at one place, as "
        "where zeros stand for joints that were not found"
    )
    remedy = "give NaN for these, or distrust the frames (trusted3d)"
    return [Finding(Severity.WARNING, subject, what, remedy)]


def examine_placeholders(subject: str, pixels: Tensor) -> list[Finding]:
    """Joints (N, 2) with confidence where files put what is not detected: 0 0, or -1 -1."""
    found = Counter(map(tuple, pixels[(pixels <= 0).all(-1)].tolist()))
    (place, count), *_ = found.most_common(1) or [((), 0)]
    if count < _PLACEHOLDERS:
        return []
    x, y = place
    what = f"{count} joints with confidence lie at ({x:g}, {y:g}) to the last digit"
    remedy = "nobody has joints there; give confidence 0 to what is not detected"
    return [Finding(Severity.WARNING, subject, what, remedy)]
