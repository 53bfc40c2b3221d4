"""3D poses of a network on the shipped clip, as its manifest reads them, and otherwise.

Signs of axes, units and names of sides do not show in a network's shapes. What is right fits the
truth of the clip two or three times as well as what is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import torch
from torch import Tensor

from perfcap.app.known_frames import known_frames
from perfcap.detect.combine import landmark_positions
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.known_person import look_around
from perfcap.detect.onnx import OnnxDetector

_JUDGED = [place for place, name in enumerate(LANDMARKS) if name[1] == "_"]
# Errors with other signs or sides, in those of the manifest's: of the two shipped networks read
# rightly it is 2.9 and more, read wrongly 0.35 and less.
_BETTER = 0.7
_SMALL, _LARGE = 0.6, 1.6  # of people by their size; the two shipped ones are 1.05 and 1.08
_FAR = 0.25  # m: 0.12 of the two shipped ones


def try_poses(network: OnnxDetector) -> Iterator[str]:
    """How well a network's 3D poses fit the shipped clip, and what in its manifest to check.

    Nothing is said of ``crop_axes``: the person is near the middle of the images.

    Args:
        network: of 3D joints; of another, nothing is said.
    """
    found = _poses(network)
    if found is None:
        return
    poses, truth = found
    if not len(poses):
        yield "to check: 3D poses are not used; they need joints for all of the 16 landmarks"
        return
    signs = network.manifest.output.signs3d
    own = _Fit.of(poses, truth)
    others = {
        f"signs3d = {[int(a * b) for a, b in zip(signs, turn, strict=True)]}": _Fit.of(
            poses * poses.new_tensor(turn), truth
        )
        for turn in product((1.0, -1.0), repeat=3)
        if turn != (1.0, 1.0, 1.0)
    }
    exchanged = poses[:, list(LANDMARKS16.mirrored())]
    others["left and right in joints.names or joints.set exchanged"] = _Fit.of(exchanged, truth)
    best = min(others, key=lambda what: others[what].off)
    yield f"3D poses are {own.words} off (median, at their best size)"
    if others[best].off < _BETTER * own.off:
        yield f"to check: with {best} they are {others[best].words} off"
        own = others[best]
    elif own.off > _FAR:
        yield (
            "to check: they are far off, and no other signs or sides are better; look at joints "
            "and at the order of axes (x right, y down, z forward)"
        )
    if not _SMALL < own.size < _LARGE:
        metres = network.manifest.output.metres * own.size
        yield (
            f"to check: they are {1 / own.size:.3g} times as large as the person; output.metres = "
            f"{metres:.2g} fits"
        )


@dataclass(frozen=True)
class _Fit:
    """How far poses are off in metres at their best size, a positive factor."""

    off: float
    size: float

    @classmethod
    def of(cls, poses: Tensor, truth: Tensor) -> _Fit:
        """Of landmarks (F, 16, 3), both about the middle of the hips."""
        size = float(((poses * truth).sum() / poses.square().sum()).clamp(min=1e-9))
        off = (size * poses - truth)[:, _JUDGED].norm(dim=-1).mean(-1).median()
        return cls(float(off), size)

    @property
    def words(self) -> str:
        return f"{1000 * self.off:.0f} mm"


def _poses(network: OnnxDetector) -> tuple[Tensor, Tensor] | None:
    """Landmarks that a network sees and true ones, (F, 16, 3) metres; None without 3D poses.

    Of frames alone in which all landmarks have a place.
    """
    frames = known_frames()
    looks = [look_around(network, frame.image, frame.joints2d) for frame in frames]
    poses = [look.joints3d for look in looks if look is not None and look.joints3d is not None]
    if len(poses) < len(frames):
        return None
    found, whole = landmark_positions(torch.stack(poses), network.joint_set)
    truth = torch.stack([torch.from_numpy(frame.joints3d) for frame in frames])
    return found.double()[whole], truth[whole]
