"""How 2D detectors err: offsets that stay, jitter that drifts, swaps, outliers and gaps.

The sizes are those of OpenPose on a real recording, measured against a triangulation of four
views (``experiments/detector_noise.py``), and a half more, since the triangulation is made from the
same detections. One unit is 1 % of a standing person's height in the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Generator, Tensor
from torch.nn.functional import max_pool1d

from perfcap.detect.joint_set import LANDMARKS
from perfcap.train.config import DetectorNoise

_INDEX = {name: i for i, name in enumerate(LANDMARKS)}
_ARMS = ("shoulder", "elbow", "wrist")
_LEGS = ("hip", "knee", "ankle", "toe")
# relative size of errors: trunk, middle of limbs, ends of limbs
_FACTOR = {"head": 1.1, "neck": 0.9, "shoulder": 0.9, "elbow": 1.1, "wrist": 1.3,
           "hip": 1.1, "knee": 1.0, "ankle": 1.0, "toe": 1.4}  # fmt: skip
_SPANS = (1, 2, 4, 8, 16)  # frames that an event lasts, each as likely


def corrupt(
    plane: Tensor, unit: Tensor, noise: DetectorNoise, generator: Generator
) -> tuple[Tensor, Tensor]:
    """Detections of exact joints.

    Args:
        plane: (N, F, 16, 2), any image coordinates.
        unit: 1 % of a person's height in these, (N, F).
        noise: what to simulate.
        generator: of all randomness.

    Returns:
        Detections (N, F, 16, 2) and their confidence, (N, F, 16), 0 where unseen.
    """
    draw = _Draw(generator, plane)
    error = _wander(draw, noise) * draw.factor[:, None] * unit[..., None, None]
    found = _swap(plane + error, noise.swaps, draw)
    low, high = plane.amin(-2, keepdim=True), plane.amax(-2, keepdim=True)
    anywhere = low + (high - low) * draw.uniform(*plane.shape)
    out = draw.uniform(*plane.shape[:3]) < noise.outliers
    found = torch.where(out[..., None], anywhere, found)
    apart = (found - plane).norm(dim=-1) / unit[..., None]
    confidence = _confidence(apart, draw)
    return found, torch.where(_unseen(noise, draw), 0.0, confidence)


@dataclass(frozen=True)
class _Draw:
    """Random numbers like a tensor (N, F, 16, 2), from one generator."""

    generator: Generator
    like: Tensor

    @property
    def factor(self) -> Tensor:
        """Relative size of the errors of each joint, (16,)."""
        sizes = [next(v for k, v in _FACTOR.items() if k in name) for name in LANDMARKS]
        return self.like.new_tensor(sizes)

    def uniform(self, *shape: int) -> Tensor:
        return torch.rand(shape, generator=self.generator, dtype=self.like.dtype)

    def normal(self, *shape: int) -> Tensor:
        return torch.randn(shape, generator=self.generator, dtype=self.like.dtype)

    def events(self, rate: float, *shape: int) -> Tensor:
        """Whether each frame (N, F, ...) is inside an event, which last 1 to 16 frames."""
        start = self.uniform(*shape) < rate
        kind = torch.randint(len(_SPANS), shape, generator=self.generator)
        inside = torch.zeros(shape, dtype=torch.bool)
        for i, span in enumerate(_SPANS):
            flags = (
                (start & (kind == i)).to(self.like).flatten(2)
                if len(shape) > 2
                else (start & (kind == i)).to(self.like)[..., None]
            )
            rows = torch.nn.functional.pad(flags.transpose(1, 2), (span - 1, 0))
            inside |= max_pool1d(rows, span, 1).transpose(1, 2).reshape(shape) > 0
        return inside


def _wander(draw: _Draw, noise: DetectorNoise) -> Tensor:
    """Offsets, drift and jitter, (N, F, 16, 2), in units."""
    clips, frames, joints, _ = draw.like.shape
    size = torch.exp(noise.spread * draw.normal(clips, 1, 1, 1)).clamp(0.3, 3.0)
    offset = noise.offset * draw.normal(clips, 1, joints, 2)
    fresh = draw.normal(clips, frames, joints, 2)
    drift = [fresh[:, 0]]
    gain = (1 - noise.keep**2) ** 0.5
    for f in range(1, frames):
        drift.append(noise.keep * drift[-1] + gain * fresh[:, f])
    jitter = noise.jitter * draw.normal(clips, frames, joints, 2)
    return size * (offset + noise.drift * torch.stack(drift, 1) + jitter)


def _swap(points: Tensor, rate: float, draw: _Draw) -> Tensor:
    clips, frames = points.shape[:2]
    both = draw.events(0.3 * rate, clips, frames)
    for limb in (_ARMS, _LEGS):
        swapped = draw.events(rate, clips, frames) | both
        points = torch.where(swapped[..., None, None], points[:, :, _mirrored(limb)], points)
    return points


def _mirrored(limb: Sequence[str]) -> list[int]:
    """Order of the landmarks with the sides of some limbs exchanged."""
    names = list(LANDMARKS)
    for part in limb:
        left, right = _INDEX[f"l_{part}"], _INDEX[f"r_{part}"]
        names[left], names[right] = names[right], names[left]
    return [_INDEX[name] for name in names]


def _confidence(apart: Tensor, draw: _Draw) -> Tensor:
    """Falls with the error, differently from detector to detector, and is never quite right."""
    clips, frames, joints = apart.shape
    top = 0.55 + 0.45 * draw.uniform(clips, 1, 1)
    scale = 6 + 9 * draw.uniform(clips, 1, 1)
    own = 1 - 0.3 * draw.uniform(clips, 1, joints) * draw.uniform(clips, frames, joints)
    return (top * own * torch.exp(-apart / scale)).clamp(0.02, 1.0)


def _unseen(noise: DetectorNoise, draw: _Draw) -> Tensor:
    clips, frames, joints, _ = draw.like.shape
    gone = draw.events(noise.gaps, clips, frames, joints)
    gone = gone | draw.events(noise.blinks, clips, frames)[..., None]
    for share, groups in (
        (noise.absent, (("head_top",), ("r_toe", "l_toe"))),
        (
            noise.hidden / 4,
            [[f"{s}_{p}" for p in limb[1:]] for limb in (_ARMS, _LEGS) for s in "rl"],
        ),
    ):
        for names in groups:
            clip = draw.uniform(clips, 1, 1) < share
            part = torch.zeros(joints, dtype=torch.bool)
            part[[_INDEX[name] for name in names]] = True
            gone = gone | (clip & part)
    return gone
