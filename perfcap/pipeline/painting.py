"""The colours of a person, taken from the frames that see each part of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.template import Template
from perfcap.geometry.camera import Camera
from perfcap.io.clip import FrameReader
from perfcap.pipeline.evidence import Evidence, Mask
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surface import SurfaceFrames
from perfcap.pipeline.trust import THRESHOLD
from perfcap.render import rasterize, vertex_normals

_SIZE = 512  # pixels along the texture
_FRAMES = 24  # that are looked at, spread over the clip
_FEWEST = 8  # trusted frames from which others are left out
_FACING = 0.3  # cosine at which a part is seen from the side at most
_SHARP = 24  # power of the cosine: the mean of many frames blurs stripes, one frame shows seams
_BEHIND = 0.015  # m by which a part may lie behind what is seen
_INSIDE = 1.0  # percent of the person's height that a part is from the rim of the mask at least
_MIRRORED = 0.03  # m between a part and the mirror image of one that was seen
_LEAST = 0.2  # of the surface, below which a body keeps its clothes
_QUALITY = 92

Colors = NDArray[np.float64]


def paint(performance: Performance, reader: FrameReader, cameras: Camera) -> Performance:
    """The same with an actor in the colours of the images; as it is where too little is seen.

    A part has the mean over frames and views that face it, weighed by a high power of the cosine.
    What no frame shows has the colour of its mirror image, or of the nearest part; light
    and shadow of the place are in the colours.

    Args:
        performance: of F frames, with silhouettes.
        reader: its frames.
        cameras: in their pixels.
    """
    template, refinement = performance.actor.template, performance.refinement
    if refinement is None or template.uv is None or performance.surface is None:
        return performance
    atlas = _Atlas.of(template)
    colors, known = atlas.seen(
        _chosen(performance), performance.shown, reader, cameras, refinement.evidence
    )
    if known.mean() < _LEAST:
        return performance
    image = atlas.image(atlas.completed(colors, known))
    encoded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    painted = replace(template, texture=encoded.tobytes(), texture_mime="image/jpeg")
    actor = Actor(painted).to(performance.motion.angles)
    return replace(performance, actor=actor)


def _chosen(performance: Performance) -> list[int]:
    """Frames that are looked at: trusted ones, where there are enough."""
    frames = np.arange(performance.frames)
    if performance.trust is not None:
        good = frames[performance.trust.value.numpy(force=True) >= THRESHOLD]
        frames = good if len(good) >= _FEWEST else frames
    places = np.linspace(0, len(frames) - 1, min(_FRAMES, len(frames))).round().astype(int)
    return [int(frame) for frame in frames[places]]


@dataclass(frozen=True, eq=False)
class _Atlas:
    """Points of a surface, one for each pixel of its texture that shows any.

    Attributes:
        pixels: rows and columns of the texture, (N,) each.
        corners: vertices of the triangle that each is on, (N, 3).
        shares: barycentric, (N, 3) float32.
        rest: where they are at rest, (N, 3) m.
        faces: of the mesh, (T, 3).
        welded: number of the place of each vertex, (V,).
        kept: a vertex at each place, (U,).
    """

    pixels: tuple[NDArray[np.int64], NDArray[np.int64]]
    corners: Tensor
    shares: Tensor
    rest: NDArray[np.float64]
    faces: Tensor
    welded: Tensor
    kept: Tensor

    @classmethod
    def of(cls, template: Template) -> _Atlas:
        """Of a template with texture coordinates."""
        faces = torch.tensor(template.faces.astype(np.int64))
        places = torch.tensor(template.uv, dtype=torch.float64) * _SIZE - 0.5
        flat = torch.ones(len(places), dtype=torch.float64)
        drawn = rasterize(places, flat, faces, (_SIZE, _SIZE))
        rows, columns = torch.nonzero(drawn.mask, as_tuple=True)
        corners = faces[drawn.triangle[rows, columns].long()]
        shares = drawn.barycentric(places, flat, faces)[rows, columns].float()
        welded, kept = template.weld()
        points = torch.tensor(template.vertices, dtype=torch.float32)
        rest = (points[corners] * shares[..., None]).sum(1).double().numpy()
        pixels = rows.numpy(), columns.numpy()
        return cls(pixels, corners, shares, rest, faces, torch.tensor(welded), torch.tensor(kept))

    def seen(
        self,
        frames: list[int],
        surface: SurfaceFrames,
        reader: FrameReader,
        cameras: Camera,
        evidence: Evidence,
    ) -> tuple[Colors, NDArray[np.bool_]]:
        """Mean colours over frames and views, (N, 3), and which parts any of them shows, (N,)."""
        colors, weights = np.zeros((len(self.rest), 3)), np.zeros(len(self.rest))
        for frame in frames:
            vertices = surface[frame : frame + 1][0].float().cpu()
            points = (vertices[self.corners] * self.shares[..., None]).sum(1)
            smooth = vertex_normals(vertices[self.kept], self.welded[self.faces])[self.welded]
            normals = (smooth[self.corners] * self.shares[..., None]).sum(1)
            at = cameras.frames(slice(frame, frame + 1)).every_frame(1)
            masks = evidence.masks(frame)
            for view, unit in enumerate(evidence.pixel_unit.tolist()):
                image = reader.read_view(view, frame, frame + 1)[0]
                camera = at.select([view]).to(points)
                weight, where = self._visible(
                    camera, vertices, points, normals, _inner(masks[view], _INSIDE * unit)
                )
                chosen = np.flatnonzero(weight > 0)
                if len(chosen):
                    weights[chosen] += weight[chosen]
                    colors[chosen] += weight[chosen, None] * _sampled(image, where[chosen])
        known = weights > 0
        colors[known] /= weights[known, None]
        return colors, known

    def _visible(
        self, camera: Camera, vertices: Tensor, points: Tensor, normals: Tensor, mask: Mask
    ) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """How well each point is seen in one view, (N,), and where, (N, 2) px."""
        size = mask.shape
        local = camera.to_camera(vertices[None])[0, 0]
        pixels = camera.project_camera(local[None, None])[0, 0]
        nearest = rasterize(pixels, local[:, 2], self.faces, size).depth
        here = camera.to_camera(points[None])[0, 0]
        where = camera.project_camera(here[None, None])[0, 0]
        column, row = where.round().nan_to_num(-1).clamp(-1e6, 1e6).long().unbind(-1)
        inside = (column >= 0) & (column < size[1]) & (row >= 0) & (row < size[0])
        column, row = column.clamp(0, size[1] - 1), row.clamp(0, size[0] - 1)
        front = here[:, 2] <= nearest[row, column] + _BEHIND
        mine = torch.from_numpy(mask)[row, column]
        toward = torch.nn.functional.normalize(camera.centre[0, 0] - points, dim=-1)
        facing = (normals * toward).sum(-1)
        good = inside & front & mine & (facing > _FACING)
        return torch.where(good, facing**_SHARP, 0).double().numpy(), where.float().numpy()

    def completed(self, colors: Colors, known: NDArray[np.bool_]) -> Colors:
        """Colours (N, 3) of all points: of their mirror images, or the nearest, where unknown."""
        tree = cKDTree(self.rest[known])
        missing = np.flatnonzero(~known)
        mirrored = self.rest[missing] * [-1.0, 1.0, 1.0]
        apart, index = tree.query(mirrored)
        _, near = tree.query(self.rest[missing])
        found = np.where(apart < _MIRRORED, index, near)
        whole = colors.copy()
        whole[missing] = colors[known][found]
        return whole

    def image(self, colors: Colors) -> NDArray[np.uint8]:
        """The texture (S, S, 3); between its parts it goes on as they end."""
        image = np.zeros((_SIZE, _SIZE, 3))
        empty = np.ones((_SIZE, _SIZE), np.bool_)
        image[self.pixels], empty[self.pixels] = colors, False
        nearest = ndimage.distance_transform_edt(empty, return_distances=False, return_indices=True)
        filled: NDArray[np.uint8] = image[tuple(nearest)].round().clip(0, 255).astype(np.uint8)
        return filled


def _inner(mask: Mask, margin: float) -> Mask:
    """Pixels so far from the rim of a mask."""
    inner: Mask = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5) > margin
    return inner


def _sampled(image: NDArray[np.uint8], where: NDArray[np.float32]) -> Colors:
    """Colours between pixels (N, 2), (N, 3)."""
    # at most 32 767 rows are remapped at once
    parts = np.array_split(where, max(1, len(where) // 30_000 + 1))
    found = [
        cv2.remap(image, part[:, :1], part[:, 1:], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
        for part in parts
    ]
    return np.concatenate(found)[:, 0].astype(np.float64)
