"""Which gross errors of detections survive in a capture: swaps, outliers, flips."""

from __future__ import annotations

import torch
from recordings import Recording
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import bone_vectors, mid_hip, retarget

_FAR_2D = 8.0  # percent of the person's height: past any jitter of the simulated detector
_FAR_3D = 0.25  # m, likewise
_CONFIDENT = 0.3
_SIDED = {"l": "r", "r": "l"}
_MIRROR = [
    LANDMARKS.index(_SIDED[n[0]] + n[1:]) if n[1] == "_" else i for i, n in enumerate(LANDMARKS)
]


def count_survivors(recording: Recording, joints: Tensor) -> dict[str, tuple[int, int]]:
    """Gross errors of each kind: how many, and how many a result follows.

    A result (F, 16, 3) follows an error when it is nearer to the detection than to the truth.

    Returns:
        By kind, (errors, survivors): ``swap`` and ``outlier`` are confident 2D joints far from
        the truth, near the other side's joint or not; ``3D`` are joints far from the truth
        relative to the root.
    """
    found = recording.cameras.project(joints)[:, 0]
    truth = recording.cameras.project(recording.truth)[:, 0]
    seen = recording.detections.joints2d[:, 0]
    far = _FAR_2D * 0.01 * recording.detections.person_height()
    confident = recording.detections.confidence2d[:, 0] > _CONFIDENT
    gross = ((seen - truth).norm(dim=-1) > far) & confident
    swapped = gross & ((seen - truth[:, _MIRROR]).norm(dim=-1) < far)
    followed = _nearer(found, seen, truth)
    flipped, kept = _survivors_3d(recording, joints)
    return {
        "swap": _count(swapped, followed),
        "outlier": _count(gross & ~swapped, followed),
        "3D": _count(flipped, kept),
    }


def _survivors_3d(recording: Recording, joints: Tensor) -> tuple[Tensor, Tensor]:
    predicted = recording.detections.joints3d
    assert predicted is not None
    lengths = bone_vectors(recording.actor.skeleton.rest_landmarks).norm(dim=-1)
    seen = retarget(predicted[:, 0], lengths) @ recording.cameras.rotation[0]  # in world axes
    truth = recording.truth - mid_hip(recording.truth)[:, None]
    found = joints - mid_hip(joints)[:, None]
    return (seen - truth).norm(dim=-1) > _FAR_3D, _nearer(found, seen, truth)


def _nearer(found: Tensor, seen: Tensor, truth: Tensor) -> Tensor:
    nearer: Tensor = (found - seen).norm(dim=-1) < (found - truth).norm(dim=-1)
    return nearer


def _count(gross: Tensor, followed: Tensor) -> tuple[int, int]:
    return int(gross.sum()), int(torch.logical_and(gross, followed).sum())
