"""How well views agree on where a person is: the measurements behind ``agreement``."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.geometry.triangulation import triangulate
from perfcap.io.doctor.detections import CONFIDENT

FRAMES = 24  # looked at, evenly spread
MIN_DEPTH = 0.1  # m; nobody is filmed from nearer
MIN_JOINTS = 30  # seen by two views, in all frames looked at, to say anything


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

    def sampled(self) -> Scene:
        """A few frames, evenly spread, of joints seen with confidence."""
        count = self.detections.frame_count
        index = torch.linspace(0, count - 1, min(count, FRAMES)).round().long()
        detections = self.detections.frames(index)
        confidence = detections.confidence2d
        kept = Detections(
            detections.joints2d,
            torch.where(confidence > CONFIDENT, confidence, 0),
            None,
            torch.zeros_like(detections.trusted3d),
        )
        return Scene(self.cameras.frames(index), kept)

    def triangulated(self, rounds: int) -> tuple[Tensor, Tensor]:
        """Points (F, 16, 3) m and residuals (F, 16) on the plane, NaN where unknown."""
        plane = self.cameras.to_plane(self.detections.joints2d)
        return triangulate(self.cameras, plane, self.detections.confidence2d, rounds)

    @property
    def focal(self) -> float:
        """Mean focal length, pixels."""
        return float(self.cameras.intrinsics[..., (0, 1), (0, 1)].mean())


def person_height(scene: Scene) -> float:
    """Typical height of a person's joints in the images, pixels; NaN when nobody is seen."""
    seen = scene.detections.confidence2d > 0
    y = scene.detections.joints2d[..., 1]
    height = y.masked_fill(~seen, -torch.inf).amax(-1) - y.masked_fill(~seen, torch.inf).amin(-1)
    height = height[seen.sum(-1) > 3]
    return float(height.median()) if len(height) else math.nan


def disagreement(scene: Scene) -> float:
    """Median residual of a joint over its degrees of freedom, pixels; infinite when unknown.

    A view gives two numbers and a point takes three, so that the same noise leaves the same
    figure whatever the number of views. A point behind a view that sees it counts as one off the
    image, since cameras in one place, say, agree on every point at that place.
    """
    points, residual = scene.triangulated(rounds=0)
    depth = scene.cameras.to_camera(points)[..., 2]
    behind = ((depth < MIN_DEPTH) & (scene.detections.confidence2d > 0)).any(-2)
    known = torch.where(behind, 1.0, residual)[~residual.isnan()]
    if len(known) < MIN_JOINTS:
        return math.inf
    views = scene.detections.views
    return float(known.median()) * scene.focal * math.sqrt(2 * views / (2 * views - 3))


def left_out_error(scene: Scene, view: int) -> float:
    """Median distance, pixels, of a view's joints from where the others see them."""
    others = [other for other in range(scene.detections.views) if other != view]
    points, _ = scene.select(others).triangulated(rounds=6)
    pixels = scene.cameras.select([view]).project(points.nan_to_num())[:, 0]
    distance = (pixels - scene.detections.joints2d[:, view]).norm(dim=-1)
    seen = (scene.detections.confidence2d[:, view] > 0) & ~points.isnan().any(-1)
    return float(distance[seen].median()) if seen.any() else math.inf
