"""Cameras that no recording was made with, although every number in them is a number."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import torch

from perfcap.io.calibration import CameraRig
from perfcap.io.doctor.finding import Finding, Severity

_SAME = 1e-9  # metres, and entries of a rotation: a copy, not a neighbour
_BENT = (0.3, 3.0)  # how far a lens moves the corner of the image towards or from its middle
_ASIDE = 0.5  # how far aside, by its tangential terms, at most


def impossible_cameras(rig: CameraRig) -> list[Finding]:
    """Views that are copies of one another, and lenses that bend the image out of shape."""
    return [*_copies(rig), *_lenses(rig)]


def _copies(rig: CameraRig) -> Iterator[Finding]:
    cameras = rig.cameras
    for one, other in combinations(range(cameras.views), 2):
        turned = cameras.rotation[..., one, :, :] - cameras.rotation[..., other, :, :]
        moved = cameras.translation[..., one, :] - cameras.translation[..., other, :]
        if max(float(turned.abs().max()), float(moved.abs().max())) < _SAME:
            subject = f"{rig.names[one]} and {rig.names[other]}"
            what = "have the same rotation and translation"
            remedy = "give each view its own; depth would come from nowhere"
            yield Finding(Severity.ERROR, subject, what, remedy)


def _lenses(rig: CameraRig) -> Iterator[Finding]:
    cameras = rig.cameras
    if cameras.distortion is None:
        return
    for view, (height, width) in enumerate(cameras.size):
        matrix = cameras.intrinsics[..., view, :, :].reshape(-1, 3, 3)
        k1, k2, p1, p2, k3 = cameras.distortion[..., view, :].reshape(-1, 5).unbind(-1)
        x, y = width / 2 / matrix[:, 0, 0], height / 2 / matrix[:, 1, 1]
        square = x.square() + y.square()
        factor = 1 + square * (k1 + square * (k2 + square * k3))
        worst = float(factor[(factor - 1).abs().argmax()])
        remedy = "check the coefficients and their order: k1, k2, p1, p2, k3"
        if not _BENT[0] < worst < _BENT[1]:
            what = f"its distortion moves the corners of the image to {worst:.3g} of their place"
            yield Finding(Severity.ERROR, rig.names[view], what, remedy)
        aside = 2 * x * y * torch.maximum(p1.abs(), p2.abs()) + 3 * square * (p1.abs() + p2.abs())
        shift = float((aside / square.sqrt()).max())
        if not shift < _ASIDE:
            what = f"its tangential distortion shifts the corners of the image by {shift:.0%}"
            yield Finding(Severity.ERROR, rig.names[view], what, remedy)
