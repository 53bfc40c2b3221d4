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
# and of what stays for a whole clip: networks do not agree where a neck or a hip is
_DEFINED = {"neck": 2.2, "hip": 1.6, "shoulder": 1.4, "toe": 1.3}
_SPANS = (1, 2, 4, 8, 16)  # frames that an event lasts, each as likely
_SLIPS = (4, 8, 16, 32, 64)  # likewise, where a limb is seen elsewhere
_SLIDING = 0.95  # share of the way there that is left after a frame
_ADMITTED = 0.35  # of an error there, that confidence knows of
_LIMBS = (("elbow", "wrist"), ("wrist",), ("knee", "ankle", "toe"), ("ankle", "toe"))


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
    found, slipped = _slip(found, unit, noise, draw)
    low, high = plane.amin(-2, keepdim=True), plane.amax(-2, keepdim=True)
    anywhere = low + (high - low) * draw.uniform(*plane.shape)
    out = draw.uniform(*plane.shape[:3]) < noise.outliers
    found = torch.where(out[..., None], anywhere, found)
    apart = (found - plane).norm(dim=-1) / unit[..., None]
    confidence = _confidence(torch.where(slipped, _ADMITTED * apart, apart), draw)
    return found, torch.where(_unseen(noise, draw), 0.0, confidence)


def unseen(plane: Tensor, noise: DetectorNoise, generator: Generator) -> Tensor:
    """Landmarks (N, F, 16) of tracks (N, F, 16, 2) that go missing, for moments or all along."""
    return _unseen(noise, _Draw(generator, plane))


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

    @property
    def defined(self) -> Tensor:
        """Relative size of what stays of these, (16,)."""
        sizes = [next((v for k, v in _DEFINED.items() if k in n), 1.0) for n in LANDMARKS]
        return self.like.new_tensor(sizes)

    def uniform(self, *shape: int) -> Tensor:
        return torch.rand(shape, generator=self.generator, dtype=self.like.dtype)

    def normal(self, *shape: int) -> Tensor:
        return torch.randn(shape, generator=self.generator, dtype=self.like.dtype)

    def events(self, rate: float, *shape: int, spans: Sequence[int] = _SPANS) -> Tensor:
        """Whether each frame (N, F, ...) is inside an event, which last as many frames as spans."""
        start = self.uniform(*shape) < rate
        kind = torch.randint(len(spans), shape, generator=self.generator)
        inside = torch.zeros(shape, dtype=torch.bool)
        for i, span in enumerate(spans):
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
    offset = noise.offset * draw.defined[:, None] * draw.normal(clips, 1, joints, 2)
    drift = noise.drift * _drift(draw, noise.keep)
    jitter = noise.jitter * draw.normal(clips, frames, joints, 2)
    return size * (offset + drift + jitter)


def _drift(draw: _Draw, keep: float) -> Tensor:
    """What changes slowly, of deviation 1, (N, F, 16, 2)."""
    fresh = draw.normal(*draw.like.shape)
    drift = [fresh[:, 0]]
    gain = (1 - keep**2) ** 0.5
    for f in range(1, fresh.shape[1]):
        drift.append(keep * drift[-1] + gain * fresh[:, f])
    return torch.stack(drift, 1)


def _slip(points: Tensor, unit: Tensor, noise: DetectorNoise, draw: _Draw) -> tuple[Tensor, Tensor]:
    """Limbs that lie elsewhere for a while: on the other one, or beside; and where, (N, F, 16)."""
    clips, frames = points.shape[:2]
    slipped = torch.zeros(points.shape[:3], dtype=torch.bool)
    beside = points + noise.slide * unit[..., None, None] * _drift(draw, _SLIDING)
    for side, other in (("l", "r"), ("r", "l")):
        for limb in _LIMBS:
            rows = [_INDEX[f"{side}_{part}"] for part in limb]
            across = [_INDEX[f"{other}_{part}"] for part in limb]
            inside = draw.events(noise.slips, clips, frames, spans=_SLIPS)
            doubled = draw.uniform(clips, 1, 1, 1) < noise.doubled
            there = torch.where(doubled, points[:, :, across], beside[:, :, rows])
            moved = points.clone()
            moved[:, :, rows] = torch.where(inside[..., None, None], there, points[:, :, rows])
            points = moved
            slipped[:, :, rows] |= inside[..., None]
    return points, slipped


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
