"""People as they are seen in frames, and whether two sightings are of one of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from torch import Tensor

from perfcap.detect.crop import Frame
from perfcap.detect.joint_set import LANDMARKS, JointSet, map_to_landmarks
from perfcap.detect.look import SEEN, Look

_SMOOTH = 2  # pixels about a spot over which its colour is averaged
_COMMON = 3  # landmarks that both sightings need to be compared by their poses
_UNALIKE = 0.25  # of the size: how much poses differ that cannot be compared
_AHEAD = 8  # frames for which whoever is hidden is taken to go on as they went
_MEMORY = 4.0  # frames in which a pose is forgotten
_POSE, _GROWTH, _CLOTHES = 2.0, 0.3, 0.4  # weights beside that of the way, in sizes of the body
_FARTHEST = 1.0  # sizes, that count of whoever was not seen for long: they may be anywhere
_DIFFERENT = 40.0  # of CIELAB in 8 bits: what clothes of other colours differ by
_LIGHTER = 0.5  # weight of lightness, which shadows change
_KEPT_SIZE = 0.97  # of the size of a body, from one sighting to the next
_RENEWED = 0.2  # of the colours, with each frame
_KINDS = ("shoulder", "hip", "knee")
_TORSO = [(u, w) for u in (0.25, 0.5, 0.75) for w in (0.25, 0.5, 0.75)]  # across, down
_THIGHS = [(u, w) for u in (0.0, 1.0) for w in (0.3, 0.5, 0.7)]


@dataclass(frozen=True)
class Sighting:
    """One person in one frame.

    Attributes:
        points: landmarks, pixels, (16, 2).
        seen: which of them are, (16,).
        colors: of the clothes on torso and thighs, CIELAB in 8 bits, (2, 3); NaN outside the image.
    """

    points: Tensor
    seen: Tensor
    colors: Tensor

    @classmethod
    def of(cls, look: Look, joint_set: JointSet, frame: Frame | None = None) -> Sighting:
        """Of a look; without colours if no frame (H, W, 3) is given."""
        points, trust = map_to_landmarks(look.joints2d[None], look.confidence[None], joint_set)
        unknown = points.new_full((2, 3), math.nan)
        colors = unknown if frame is None else _clothes(points[0], frame)
        return cls(points[0], trust[0] >= SEEN, colors)

    @property
    def middle(self) -> Tensor:
        """Of the landmarks that are seen, (2,)."""
        return self._known().mean(0)

    @property
    def size(self) -> float:
        """Longer side of their box, pixels."""
        points = self._known()
        return max(float((points.amax(0) - points.amin(0)).max()), 1.0)

    def _known(self) -> Tensor:
        return self.points[self.seen] if self.seen.any() else self.points

    def apart(self, other: Sighting) -> float:
        """Distance of the middles, in sizes of the larger one."""
        return float((self.middle - other.middle).norm()) / max(self.size, other.size)

    def moved(self, other: Sighting) -> tuple[Tensor, float]:
        """The way to another one, pixels, (2,), and how much their poses differ, of the size."""
        both = self.seen & other.seen
        if int(both.sum()) < _COMMON:
            return other.middle - self.middle, _UNALIKE
        ways = (other.points - self.points)[both]
        way = ways.median(0).values  # a limb that is seen once more moves no mean
        off = (ways - way).norm(dim=-1).clamp(max=0.5 * self.size)
        return way, float(off.mean()) / self.size

    def unlike(self, other: Sighting) -> float:
        """How much the clothes differ in colour, 0 to 1."""
        apart = (self.colors - other.colors) * self.colors.new_tensor([_LIGHTER, 1.0, 1.0])
        known = apart.norm(dim=-1)
        known = known[known.isfinite()]
        return float((known / _DIFFERENT).clamp(max=1).mean()) if len(known) else 0.0


@dataclass(frozen=True)
class Trace:
    """Somebody who is followed.

    Attributes:
        last: the last sighting, with colours of all.
        size: of the body, pixels: as of the largest of late.
        speed: pixels a frame, (2,).
        age: frames since the last sighting.
        count: sightings.
        beside: of them, those in whose frame the person was seen as well whom all is about.
    """

    last: Sighting
    size: float
    speed: Tensor
    age: int = 0
    count: int = 1
    beside: int = 0

    @classmethod
    def from_sighting(cls, sighting: Sighting) -> Trace:
        """Of somebody new."""
        return cls(sighting, sighting.size, sighting.points.new_zeros(2))

    def after(self, sighting: Sighting | None) -> Trace:
        """One frame later."""
        if sighting is None:
            return replace(self, age=self.age + 1)
        speed = self.last.moved(sighting)[0] / (self.age + 1)
        if self.count > 1:
            speed = 0.5 * (self.speed + speed)
        old, new = self.last.colors, sighting.colors
        colors = torch.where(new.isfinite(), torch.lerp(old, new, _RENEWED), old)
        colors = torch.where(old.isfinite(), colors, new)
        last = replace(sighting, colors=colors)
        size = max(sighting.size, _KEPT_SIZE * self.size)  # some see a part of a body
        return replace(self, last=last, size=size, speed=speed, age=0, count=self.count + 1)

    def cost(self, sighting: Sighting, anywhere: bool = False) -> float:
        """How unlikely a sighting in the next frame is of this person, in sizes of the body.

        By the way from where they would be by now, how much the pose changed, the size and the
        colours of the clothes.

        Args:
            sighting: in the frame after.
            anywhere: whether they may have gone far since.
        """
        way, pose = self.last.moved(sighting)
        steps = min(self.age + 1, _AHEAD)
        off = float((way - steps * self.speed).norm()) / self.size
        growth = min(abs(math.log(sighting.size / self.size)), 1.0)
        return (
            (min(off, _FARTHEST) if anywhere else off)
            + _GROWTH * growth
            + _POSE * math.exp(-self.age / _MEMORY) * pose
            + _CLOTHES * self.last.unlike(sighting)
        )


def _clothes(points: Tensor, frame: Frame) -> Tensor:
    """Median colours of torso and thighs, (2, 3), by landmarks (16, 2)."""
    shoulders, hips, knees = (
        points[[LANDMARKS.index(f"{side}_{kind}") for side in "lr"]] for kind in _KINDS
    )
    found = []
    for upper, lower, places in ((shoulders, hips, _TORSO), (hips, knees, _THIGHS)):
        across = points.new_tensor([u for u, _ in places])[:, None]
        down = points.new_tensor([w for _, w in places])[:, None]
        spots = torch.lerp(
            torch.lerp(upper[:1], upper[1:], across), torch.lerp(lower[:1], lower[1:], across), down
        )
        found.append(_median_color(spots, frame))
    return torch.stack(found)


def _median_color(spots: Tensor, frame: Frame) -> Tensor:
    """Of what is about spots (n, 2), each smoothed; (3,), NaN if none is inside the frame."""
    height, width = frame.shape[:2]
    x, y = spots.round().long().numpy().T
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    if not inside.any():
        return spots.new_full((3,), math.nan)
    step = np.arange(-_SMOOTH, _SMOOTH + 1)
    columns = np.clip(x[inside, None] + step, 0, width - 1)[:, None, :]
    rows = np.clip(y[inside, None] + step, 0, height - 1)[:, :, None]
    mean = frame[rows, columns].mean((1, 2)).round().astype(np.uint8)
    lab = cv2.cvtColor(mean[:, None], cv2.COLOR_RGB2LAB)[:, 0]
    return torch.from_numpy(lab).to(spots).median(0).values
