"""Detections as rays, and the points in which the rays of several views cross."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.geometry.camera import NEAR, Camera
from perfcap.geometry.triangulation import triangulate
from perfcap.setting_checks import Settings

# --- Sizes that tell one person from two ----------------------------------------------------------


@dataclass(frozen=True)
class AssociationConfig(Settings):
    """Lengths in metres at the person, times in seconds; all are about people, none about a clip.

    Attributes:
        same: mean distance of the joints' rays up to which detections of two views may be of one
            person; detectors are off by a few centimetres, the next person is farther away.
        patience: how much more each further view may add to it, as a share.
        robust: distance at which a joint's ray counts half.
        saturated: distance beyond which a joint is wrong, whatever it is.
        least_joints: that two views must both see.
        reach: half the size of people, least and most.
        apart: median distance of joints below which two skeletons are one.
        beside: the same of somebody new: nobody appears inside of somebody else.
        stray: how far somebody is from where they were expected, beyond their speed.
        speed: of people, m/s.
        memory: how long somebody may be unseen and still be known by place alone.
        smooth: standard deviation of the time in which places are averaged.
        shortest: a track below this, and below a tenth of the clip, is nobody.
        torn: share of a track's frames in which views of one person may fall apart in two.
        bones: root-mean-square difference of log bone lengths up to which two tracks may be one
            person who was away.
        confident: detections below are not looked at.
        mirrored: what it costs to take left for right, m, where a detector does so.
        clearer: how much nearer a limb must be to somebody else, m, to be theirs.
        twice: mean distance, as a share of the person's size in the image, of a detection that is
            listed twice.
        resized: whether to ask if detections are in pixels of videos of another size; those that
            were found in the very images are not.
    """

    same: float = 0.10
    patience: float = 0.15
    robust: float = 0.06
    saturated: float = 0.4
    least_joints: int = 5
    reach: tuple[float, float] = (0.15, 1.4)
    apart: float = 0.12
    beside: float = 0.25
    stray: float = 0.3
    speed: float = 8.0
    memory: float = 1.0
    smooth: float = 0.05
    shortest: float = 1.0
    torn: float = 0.6
    bones: float = 0.06
    confident: float = 0.1
    mirrored: float = 0.02
    clearer: float = 0.1
    twice: float = 0.02
    resized: bool = True


# --- Detections as rays, and the points in which the rays of several views cross ------------------

_CHUNK = 4096  # groups crossed at once: bounds memory
_ROUNDS = 3
_QUANTILE = 0.9  # of joints, that a size is measured on: one of them may be anywhere


@dataclass(frozen=True)
class Crossing:
    """Where the joints of groups of detections are.

    Attributes:
        points: (N, J, 3) m, NaN where fewer than two views see a joint.
        misfit: mean distance of rays from points, m, (N,); infinite where it is no person.
    """

    points: Tensor
    misfit: Tensor


@dataclass(frozen=True)
class Sightings:
    """Who was seen, as rays.

    Attributes:
        cameras: C views, (C,) or (F, C).
        plane: undistorted image coordinates, (F, C, P, J, 2).
        weights: confidence, (F, C, P, J); 0 where nothing is seen.
        config: sizes.
    """

    cameras: Camera
    plane: Tensor
    weights: Tensor
    config: AssociationConfig

    @classmethod
    def of(cls, cameras: Camera, candidates: Detections, config: AssociationConfig) -> Self:
        """Those of candidates (P, F, C), without what is too unsure or listed twice."""
        cameras = cameras.to(candidates.joints2d)
        plane = cameras.to_plane(candidates.joints2d).movedim(0, 2)
        weights = candidates.confidence2d.movedim(0, 2)
        weights = torch.where(weights >= config.confident, weights, 0)
        weights = torch.where(plane.isfinite().all(-1), weights, 0)
        plane = torch.where(weights[..., None] > 0, plane, 0)
        return cls(cameras, plane, _once(plane, weights, config), config)

    @property
    def there(self) -> Tensor:
        """Whether a slot holds enough joints to be somebody, (F, C, P)."""
        return (self.weights > 0).sum(-1) >= self.config.least_joints

    def rays(self, frames: Tensor, members: Tensor) -> tuple[Tensor, Tensor]:
        """Plane coordinates (N, C, J, 2) and weights (N, C, J) of slots (N, C), -1 for none."""
        views = torch.arange(members.shape[1])
        at = (frames[:, None], views, members.clamp(min=0))
        return self.plane[at], torch.where(members[..., None] >= 0, self.weights[at], 0)

    def cross(self, frames: Tensor, members: Tensor) -> Crossing:
        """Cross the rays of groups: ``members`` (N, C) are slots of frames (N,), -1 for none."""
        parts = [self._cross(frames[span], members[span]) for span in _spans(len(frames), _CHUNK)]
        if not parts:
            empty = self.plane.new_zeros(0)
            return Crossing(self.plane.new_zeros(0, self.plane.shape[-2], 3), empty)
        return Crossing(
            torch.cat([part.points for part in parts]), torch.cat([part.misfit for part in parts])
        )

    def distances(self, frames: Tensor, points: Tensor, plane: Tensor) -> Tensor:
        """Distance in metres of points (N, J, 3) from rays (N, C, ..., J, 2), (N, C, ..., J).

        Points behind a camera are infinitely far, unknown ones NaN.
        """
        local = self.cameras.frames(frames).to_camera(points)
        local = local.reshape(*local.shape[:2], *[1] * (plane.dim() - 4), *local.shape[2:])
        depth = local[..., 2]
        off = (local[..., :2] / depth.clamp(min=NEAR)[..., None] - plane).norm(dim=-1) * depth
        return torch.where(depth < NEAR, torch.inf, off)

    def _cross(self, frames: Tensor, members: Tensor) -> Crossing:
        config = self.config
        plane, weights = self.rays(frames, members)
        cameras = self.cameras.frames(frames)
        scale = config.robust / self._distance(frames)
        points, _ = triangulate(cameras, plane, weights, _ROUNDS, scale)
        known = points.isfinite().all(-1)
        counted = (weights > 0) & known[:, None]
        off = self.distances(frames, points, plane).nan_to_num(nan=0).clamp(max=config.saturated)
        misfit = (off * counted).sum((1, 2)) / counted.sum((1, 2)).clamp(min=1)
        return Crossing(points, torch.where(self._is_person(points, known), misfit, torch.inf))

    def _distance(self, frames: Tensor) -> float:
        """Typical distance of people from the cameras, m: that of the cameras' middle."""
        centre = self.cameras.frames(frames).centre
        spread = (centre - centre.mean(-2, keepdim=True)).norm(dim=-1)
        return float(spread.mean().clamp(min=1.0))

    def _is_person(self, points: Tensor, known: Tensor) -> Tensor:
        """Whether enough joints lie as far from each other as those of people, (N,)."""
        least, most = self.config.reach
        middle = points.nanmedian(-2, keepdim=True).values
        radius = (points - middle).norm(dim=-1).nanquantile(_QUANTILE, -1)
        fits: Tensor = (radius >= least) & (radius <= most)  # false for NaN
        fits = fits & (known.sum(-1) >= self.config.least_joints)
        return fits


def _once(plane: Tensor, weights: Tensor, config: AssociationConfig) -> Tensor:
    """Weights without those of slots that repeat another, surer one, (F, C, P, J)."""
    weights = weights.clone()
    for slot in range(1, weights.shape[2]):
        for other in range(slot):
            both = (weights[:, :, slot] > 0) & (weights[:, :, other] > 0)
            count = both.sum(-1)
            off = (plane[:, :, slot] - plane[:, :, other]).norm(dim=-1)
            mean = (off * both).sum(-1) / count.clamp(min=1)
            size = _extent(plane[:, :, other], weights[:, :, other] > 0)
            same = (count >= config.least_joints) & (mean < config.twice * size)
            surer = weights[:, :, slot].sum(-1) > weights[:, :, other].sum(-1)
            weights[:, :, slot] *= ~(same & ~surer)[..., None]
            weights[:, :, other] *= ~(same & surer)[..., None]
    return weights


def _extent(plane: Tensor, seen: Tensor) -> Tensor:
    """Diagonal of the box of joints that are seen, (F, C)."""
    low = torch.where(seen[..., None], plane, torch.inf).amin(-2)
    high = torch.where(seen[..., None], plane, -torch.inf).amax(-2)
    size: Tensor = (high - low).clamp(min=0).nan_to_num(nan=0, posinf=0).norm(dim=-1)
    return size


def _spans(count: int, size: int) -> Iterator[slice]:
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))
