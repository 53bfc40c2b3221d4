"""What cameras see of a surface: label maps, and pairs of its contours with those of masks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.geometry.camera import Camera
from perfcap.pipeline.surface_config import ContourConfig
from perfcap.render import LabelMap, MeshEdges, rasterize
from perfcap.render.label_map import Box, cover, surrounding
from perfcap.render.occluding_contour import occluding_contour
from perfcap.render.part_depth import part_depth
from perfcap.segment import Contour, Matches
from perfcap.segment.matching import match

Mask = NDArray[np.bool_]

_MARGIN = 3  # px around a surface: contours look as far beyond it


@dataclass(frozen=True)
class Outline:
    """Where a surface is in one frame and view.

    Attributes:
        seen: in a part of the image, (h, w) bool.
        part: rows and columns of the image, which hold the surface.
        size: of the image, (H, W).
    """

    seen: Mask
    part: Box
    size: tuple[int, int]

    @property
    def mask(self) -> Mask:
        """Where it is in the image, (H, W) bool."""
        mask = np.zeros(self.size, np.bool_)
        mask[self.part] = self.seen
        return mask


@dataclass(frozen=True)
class View:
    """A surface in one frame and view.

    Attributes:
        pixels: of the vertices, (V, 2) px.
        depth: of the vertices, (V,) m.
        labels: what is seen, (h, w), of the part of the image that holds the surface.
        size: of the image, (H, W).
    """

    pixels: NDArray[np.float64]
    depth: NDArray[np.float64]
    labels: LabelMap
    size: tuple[int, int]

    @property
    def part(self) -> Box:
        """Rows and columns of the image that hold the surface."""
        sides = zip(self.labels.corner, self.labels.triangle.shape, strict=True)
        rows, columns = (slice(first, first + side) for first, side in sides)
        return rows, columns

    @property
    def outline(self) -> Outline:
        """Where the surface is."""
        return Outline(self.labels.mask.numpy(), self.part, self.size)

    @property
    def mask(self) -> Mask:
        """Where it is in the image, (H, W) bool."""
        return self.outline.mask


Drawn = TypeVar("Drawn", View, Outline)


class Sight:
    """Cameras looking at a mesh.

    Args:
        cameras: C views in pixels of their images, (C,) or (F, C), with their sizes.
        faces: of the mesh, (T, 3).
        welded: vertices at one place, split by texture seams, share a number, (V,).
        parts: the limb each triangle belongs to, (T,); all one when not given.
    """

    def __init__(
        self,
        cameras: Camera,
        faces: Tensor,
        welded: NDArray[np.int64],
        parts: NDArray[np.int64] | None = None,
    ) -> None:
        self.cameras = cameras
        self.parts = parts
        self.faces = faces.cpu()
        self.edges = MeshEdges.build(self.faces.numpy(), welded)

    @property
    def views(self) -> int:
        """C."""
        return self.cameras.views

    def through(self, cameras: Camera) -> Sight:
        """The same mesh as other cameras see it."""
        other = copy(self)
        other.cameras = cameras
        return other

    def look(
        self, vertices: Tensor, frames: slice, views: Sequence[int] | None = None
    ) -> list[list[View]]:
        """Draw surfaces (f, V, 3) at the clip's ``frames``: ``[frame][view]``, in some views."""
        return list(self.stream(vertices, frames, views))

    def stream(
        self, vertices: Tensor, frames: slice, views: Sequence[int] | None = None
    ) -> Iterator[list[View]]:
        """The same, each frame drawn when it is asked for: views of large images are large."""
        return self._each(self._drawn, vertices, frames, views)

    def outlines(
        self, vertices: Tensor, frames: slice, views: Sequence[int] | None = None
    ) -> Iterator[list[Outline]]:
        """Where surfaces (f, V, 3) are, and nothing else, which is found in half the time."""
        return self._each(self._outline, vertices, frames, views)

    def _each(
        self,
        draw: Callable[[Tensor, Tensor, tuple[int, int]], Drawn],
        vertices: Tensor,
        frames: slice,
        views: Sequence[int] | None,
    ) -> Iterator[list[Drawn]]:
        chosen = list(range(self.views)) if views is None else list(views)
        cameras = self.cameras.frames(frames).select(chosen)
        local = cameras.to_camera(vertices.to(cameras.rotation))  # kept ones are float32
        pixels, depth = cameras.project_camera(local).cpu(), local[..., 2].cpu()
        for f in range(len(vertices)):
            yield [draw(pixels[f, c], depth[f, c], cameras.size[c]) for c in range(cameras.views)]

    def _drawn(self, pixels: Tensor, depth: Tensor, size: tuple[int, int]) -> View:
        """One frame and view of vertices at pixels (V, 2) px and depth (V,) m."""
        part = surrounding(pixels, depth, size, _MARGIN)
        labels = rasterize(pixels, depth, self.faces, size, part=part)
        return View(pixels.double().numpy(), depth.double().numpy(), labels, size)

    def _outline(self, pixels: Tensor, depth: Tensor, size: tuple[int, int]) -> Outline:
        """The same."""
        part = surrounding(pixels, depth, size, 0)
        return Outline(cover(pixels, depth, self.faces, size, part).numpy(), part, size)

    def correspond(
        self,
        drawn: Sequence[View],
        contours: Sequence[Contour],
        config: ContourConfig,
        heights: Sequence[float],
    ) -> list[Matches]:
        """Pairs between the contours of a drawn surface and those of masks, one frame: ``[C]``.

        Args:
            drawn: the surface in every view.
            contours: those of its masks.
            config: spacing and limits.
            heights: of the upright person in every view, px.
        """
        rows = zip(drawn, contours, heights, strict=True)
        return [self._match(*row, config) for row in rows]

    def _match(self, view: View, contour: Contour, height: float, config: ContourConfig) -> Matches:
        mesh = (view.pixels, view.depth, self.edges, view.labels)
        model = occluding_contour(*mesh, config.spacing)
        room = None
        if self.parts is not None:
            triangle, corner = view.labels.triangle.numpy(), view.labels.corner
            line = (model.points, model.normals, triangle)
            room = part_depth(*line, 0.2 * height, corner, self.parts)
        return match(model, _beyond(contour, config.chance), config.matching, height, room)


def _beyond(contour: Contour, chance: float) -> Contour:
    """The contour with what its confidence says more than chance does, 0 to 1."""
    return replace(contour, confidence=np.maximum(contour.confidence - chance, 0) / (1 - chance))
