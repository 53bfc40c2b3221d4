"""Landmarks of a bare mesh: a joint detector looks at pictures of it from all sides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.bare_mesh import BareMesh
from perfcap.detect.detections import Detections
from perfcap.detect.look import Box
from perfcap.geometry.camera import NEAR, Camera
from perfcap.geometry.triangulation import triangulate
from perfcap.render import ProjectedMesh, Texture, look_at, render
from perfcap.setting_checks import Settings

_PLAIN, _WALL = (178, 178, 178), (96, 108, 120)  # sRGB of a mesh without texture, and behind it


class JointDetector(Protocol):
    """What finds joints in images, such as ``OnnxDetector``."""

    def __call__(
        self,
        images: Tensor,
        boxes: Sequence[Box | None] | None = None,
        cameras: Camera | None = None,
    ) -> Detections:
        """Landmarks in images (F, C, 3, H, W) uint8; boxes of the person in the first frame."""


@dataclass(frozen=True)
class ViewSettings(Settings):
    """What a detector is shown, and when its views agree.

    Attributes:
        views: around the person, the first from ahead.
        lift: angles of every other view and of those between above the horizon, degrees.
        side: of the square pictures, px.
        fill: share of a picture that the person takes.
        distance: of the cameras, in extents of the person.
        agree: distance at the person up to which a view agrees with others, metres.
        fewest: views that must agree on a landmark.
        landmarks: that must be found for the mesh to show a person.
    """

    views: int = 8
    lift: tuple[float, float] = (0.0, 20.0)
    side: int = 512
    fill: float = 0.8
    distance: float = 2.2
    agree: float = 0.06
    fewest: int = 3
    landmarks: int = 6


@dataclass(frozen=True, eq=False)
class SeenLandmarks:
    """The 16 landmarks as views agree on them.

    Attributes:
        places: metres, in the axes of the mesh, (16, 3); zero where not found.
        trust: share of the views' confidence that agrees, (16,); 0 where not found.
        views: in how many views the person was found, and of how many.
    """

    places: Tensor
    trust: Tensor
    views: tuple[int, int]

    @property
    def found(self) -> int:
        """How many landmarks."""
        return int((self.trust > 0).sum())


def see_landmarks(
    mesh: BareMesh, detector: JointDetector, settings: ViewSettings | None = None
) -> SeenLandmarks:
    """Draw a person from all sides, detect joints, and triangulate where views agree.

    Args:
        mesh: upright, y up, metres.
        detector: of joints in images.
        settings: how.

    Raises:
        InputError: its texture cannot be decoded.
    """
    settings = settings or ViewSettings()
    cameras = surrounding_cameras(mesh, settings)
    pixels = cameras.project(torch.from_numpy(mesh.vertices)[None])[0]
    boxes = [_box(at) for at in pixels]
    detections = detector(_pictures(mesh, cameras)[None], boxes, cameras)
    plane = cameras.to_plane(detections.joints2d.double())[0]
    confidence = detections.confidence2d.double()[0]
    apart = float((cameras.centre[0] - _middle(mesh)).norm())
    places, trust = agreed_points(
        cameras, plane, confidence, settings.agree / apart, settings.fewest
    )
    return SeenLandmarks(places, trust, (int((confidence > 0).any(-1).sum()), settings.views))


def surrounding_cameras(mesh: BareMesh, settings: ViewSettings) -> Camera:
    """Cameras (C,) around an upright mesh that see all of it."""
    count, middle = settings.views, _middle(mesh)
    extent = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    turn = 2 * math.pi / count * torch.arange(count, dtype=torch.float64)
    lift = torch.tensor([math.radians(settings.lift[i % 2]) for i in range(count)]).to(turn)
    level = lift.cos()
    away = torch.stack((level * turn.sin(), lift.sin(), level * turn.cos()), -1)
    up = torch.tensor([0.0, 1.0, 0.0]).to(away)
    rotation, translation = look_at(middle + settings.distance * extent * away, middle, up)
    centre = 0.5 * (settings.side - 1)
    focal = settings.fill * settings.side * settings.distance
    matrix = torch.tensor([[focal, 0, centre], [0, focal, centre], [0, 0, 1]]).to(away)
    size = ((settings.side, settings.side),) * count
    return Camera(matrix.repeat(count, 1, 1), rotation, translation, size=size)


def agreed_points(
    cameras: Camera, plane: Tensor, confidence: Tensor, agree: float, fewest: int
) -> tuple[Tensor, Tensor]:
    """Points that most views agree on: of all pairs of views the one that most others confirm.

    All pairs are tried, as a consensus by random samples (Fischler and Bolles 1981) does with
    some; the views that confirm the best pair triangulate the point together.

    Args:
        cameras: C views.
        plane: undistorted image coordinates, (C, N, 2).
        confidence: (C, N), 0 where a view does not see a point.
        agree: image error, in units of ``plane``, up to which a view confirms a point.
        fewest: views that must confirm it.

    Returns:
        Points (N, 3), zero where views do not agree, and the share of the confidence that agrees,
        (N,), zero there: fewer than ``fewest`` views, or than half of the confidence.
    """
    pairs = torch.combinations(torch.arange(cameras.views, device=plane.device))
    member = torch.zeros(len(pairs), cameras.views).to(plane).scatter_(1, pairs, 1.0)
    weights = member[:, None, :, None] * confidence  # P 1 C N
    points, _ = triangulate(cameras, plane.expand(len(pairs), 1, -1, -1, -1), weights, rounds=0)
    error = _image_error(cameras, points[:, 0], plane).nan_to_num(torch.inf)  # P C N
    support = (confidence * (1 - (error / agree).square()).clamp(min=0)).sum(1)  # P N
    best = support.argmax(0)
    near = error.gather(0, best.expand(1, cameras.views, -1))[0] < agree
    inside = confidence * near
    together, _ = triangulate(cameras, plane[None], inside[None], scale=agree)
    share = inside.sum(0) / confidence.sum(0).clamp(min=1e-12)
    well = ((inside > 0).sum(0) >= fewest) & (share >= 0.5) & together[0].isfinite().all(-1)
    return torch.where(well[:, None], together[0], 0.0), torch.where(well, share, 0.0)


def _image_error(cameras: Camera, points: Tensor, plane: Tensor) -> Tensor:
    """Distance of points (P, N, 3) from where views see them (C, N, 2), (P, C, N)."""
    local = cameras.to_camera(points)
    error: Tensor = (local[..., :2] / local[..., 2:].clamp(min=NEAR) - plane).norm(dim=-1)
    return error


def _pictures(mesh: BareMesh, cameras: Camera) -> Tensor:
    """What the cameras see, (C, 3, H, W) uint8."""
    split = torch.from_numpy(mesh.faces)
    if mesh.texture is None or mesh.uv is None:
        texture = Texture.plain(_PLAIN, len(split))
    else:
        uv = torch.tensor(mesh.uv, dtype=torch.float32)
        texture = Texture.decode(mesh.texture, uv, split, f"mesh {mesh.name!r}")
    places, index = np.unique(mesh.vertices, axis=0, return_inverse=True)
    vertices, faces = torch.tensor(places).float(), torch.from_numpy(index.reshape(-1))[split]
    drawn = []
    for view, size in enumerate(cameras.size):
        seen = ProjectedMesh.seen_by(cameras.select([view]), vertices, faces)
        wall = torch.tensor(_WALL, dtype=torch.uint8).expand(*size, 3)
        drawn.append(render(seen, texture, wall).image.permute(2, 0, 1))
    return torch.stack(drawn)


def _box(pixels: Tensor) -> Box:
    left, top, right, bottom = torch.cat((pixels.amin(0), pixels.amax(0))).tolist()
    return left, top, right, bottom


def _middle(mesh: BareMesh) -> Tensor:
    return torch.from_numpy(0.5 * (mesh.vertices.min(0) + mesh.vertices.max(0)))
