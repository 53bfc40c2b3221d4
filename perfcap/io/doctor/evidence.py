"""How well views agree on where a person is: the measurements behind ``agreement``."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.extent import end_to_end
from perfcap.geometry.camera import Camera
from perfcap.geometry.triangulation import triangulate
from perfcap.io.doctor.detections import CONFIDENT

FRAMES = 24  # looked at, evenly spread
MIN_DEPTH = 0.1  # m; nobody is filmed from nearer
_AHEAD = 0.01  # m, along a ray: short enough for a direction in an image
MIN_JOINTS = 30  # seen by two views, in all frames looked at, to say anything
CROSSING = 0.35  # sine of the angle at which two rays place a joint well enough along both
BETTER = 0.65  # a mistake explains the disagreement if undoing it leaves at most this share


@dataclass(frozen=True)
class Scene:
    """Cameras (C,) or (F, C) and what they see, (F, C)."""

    cameras: Camera
    detections: Detections

    def select(self, views: list[int]) -> Scene:
        """Some views, in the order given."""
        return Scene(self.cameras.select(views), self.detections.select(views))

    def straightened(self) -> Scene:
        """The same seen through lenses without distortion, which many trials then cost less."""
        ideal = replace(self.cameras, distortion=None)
        plane = self.cameras.to_plane(self.detections.joints2d)
        local = torch.cat((plane, torch.ones_like(plane[..., :1])), -1)
        return Scene(ideal, replace(self.detections, joints2d=ideal.project_camera(local)))

    def frames(self, index: Tensor) -> Scene:
        """Some frames, in the order given."""
        return Scene(self.cameras.frames(index), self.detections.frames(index))

    def common(self) -> Tensor:
        """The frames in which two views surely see a joint, (N,).

        What detectors find with hardly any confidence where a person has left is no sight of them.
        """
        sure = self.detections.confidence2d > CONFIDENT
        return (sure.sum(1) > 1).any(-1).nonzero().flatten()

    def sure(self) -> Scene:
        """Joints seen with confidence alone, and no 3D poses."""
        seen = self.detections
        confidence = torch.where(seen.confidence2d > CONFIDENT, seen.confidence2d, 0)
        untrusted = torch.zeros_like(seen.trusted3d)
        return Scene(self.cameras, Detections(seen.joints2d, confidence, None, untrusted))

    def sampled(self, frames: int = FRAMES) -> Scene:
        """So many frames, evenly spread over those in common, of joints seen with confidence."""
        common = self.common()
        known = common if len(common) else torch.arange(self.detections.frame_count)
        index = torch.linspace(0, len(known) - 1, min(len(known), frames)).round().long()
        return self.frames(known[index.to(known)]).sure()

    def triangulated(self, rounds: int) -> tuple[Tensor, Tensor]:
        """Points (F, 16, 3) m and residuals (F, 16) on the plane, NaN where unknown."""
        plane = self.cameras.to_plane(self.detections.joints2d)
        return triangulate(self.cameras, plane, self.detections.confidence2d, rounds)

    def rays(self, points: Tensor) -> Tensor:
        """Directions from views that see points (F, 16, 3) to them, (F, C, 16, 3); 0 of others."""
        seen = (self.detections.confidence2d > 0)[..., None]
        away = points[:, None] - self.cameras.centre[..., None, :]
        return torch.where(seen, torch.nn.functional.normalize(away, dim=-1), 0)

    def crossing(self, points: Tensor) -> Tensor:
        """Sine of the angle at which the rays of two views that see a point cross, (F, 16).

        Of the two that cross best; 0 where none do. Along rays that hardly cross, as between two
        cameras that look at each other, little says where a point is.
        """
        best = torch.zeros_like(points[..., 0])
        for one, other in combinations(self.rays(points).unbind(1), 2):
            best = torch.maximum(best, torch.linalg.cross(one, other).norm(dim=-1).nan_to_num())
        return best

    @property
    def focal(self) -> float:
        """Mean focal length, pixels."""
        return float(self.cameras.intrinsics[..., (0, 1), (0, 1)].mean())


def person_height(scene: Scene) -> float:
    """Typical size of a person in the images, end to end, pixels; NaN when nobody is seen."""
    seen = scene.detections.confidence2d > 0
    height = end_to_end(scene.detections.joints2d, seen)[seen.sum(-1) > 3]
    return float(height.median()) if len(height) else math.nan


def disagreement(scene: Scene) -> float:
    """Median residual of a joint over its degrees of freedom, pixels; infinite when unknown.

    A view gives two numbers and a point takes three, so that the same noise leaves the same
    figure whatever the number of views. A point behind a view that sees it counts as one off the
    image, since cameras in one place, say, agree on every point at that place.
    """
    return disagreement_of(scene, joint_residuals(scene))


def disagreement_of(scene: Scene, residuals: Tensor) -> float:
    """The same by residuals of joints on the plane, NaN where unknown."""
    known = residuals[~residuals.isnan()]
    if len(known) < MIN_JOINTS:
        return math.inf
    views = scene.detections.views
    return float(known.median()) * scene.focal * math.sqrt(2 * views / (2 * views - 3))


def frame_residuals(scene: Scene) -> Tensor:
    """The median residual of each frame, (F,), on the plane; NaN of frames that nobody is in."""
    return joint_residuals(scene).nanmedian(-1).values


def joint_residuals(scene: Scene) -> Tensor:
    """The residual of each joint, (F, 16), on the plane; NaN where unknown."""
    points, residual = scene.triangulated(rounds=0)
    depth = scene.cameras.to_camera(points)[..., 2]
    behind = ((depth < MIN_DEPTH) & (scene.detections.confidence2d > 0)).any(-2)
    return torch.where(behind & ~residual.isnan(), 1.0, residual)


def left_out_errors(scene: Scene, view: int) -> Tensor:
    """Distances of a view's joints from where the others see them, (F, 16) px, NaN if unknown.

    Where the rays of the others hardly cross, a joint may be anywhere along them.
    """
    rest = scene.select([other for other in range(scene.detections.views) if other != view])
    points, _ = rest.triangulated(rounds=6)
    own = scene.cameras.select([view])
    pixels = own.project(points.nan_to_num())[:, 0]
    offset = pixels - scene.detections.joints2d[:, view]
    rays = rest.rays(points)
    first = rays.norm(dim=-1).argmax(1)[:, None, :, None].expand(-1, 1, -1, 3)
    ahead = points + _AHEAD * rays.gather(1, first)[:, 0]
    along = own.project(ahead.nan_to_num())[:, 0] - pixels
    along = torch.nn.functional.normalize(along, dim=-1)
    across = offset[..., 0] * along[..., 1] - offset[..., 1] * along[..., 0]
    vague = rest.crossing(points) < CROSSING
    distance = torch.where(vague, across.abs(), offset.norm(dim=-1))
    seen = (scene.detections.confidence2d[:, view] > 0) & ~points.isnan().any(-1)
    return torch.where(seen, distance, torch.nan)


def left_out_error(scene: Scene, view: int) -> float:
    """The median of ``left_out_errors``; infinite when unknown."""
    distance = left_out_errors(scene, view)
    known = distance[~distance.isnan()]
    return float(known.median()) if len(known) else math.inf


def beside(cameras: Camera, detections: Detections, points: Tensor) -> Tensor:
    """How far joints of a solved person lie from those detected, shares of the person's box.

    Args:
        cameras: C views, (C,) or (F, C).
        detections: (F, C).
        points: landmarks of the person, (F, 16, 3).

    Returns:
        (F, C, 16), NaN where a joint is not seen.
    """
    seen = (detections.confidence2d > CONFIDENT) & detections.joints2d.isfinite().all(-1)
    high, low = (
        part(detections.joints2d.where(seen[..., None], sign * torch.inf), 2)
        for part, sign in ((torch.amax, -1), (torch.amin, 1))
    )
    size = (high - low).norm(dim=-1, keepdim=True)  # (F, C, 1)
    off = (cameras.project(points) - detections.joints2d).norm(dim=-1) / size
    return torch.where(seen, off, torch.nan)
