"""A captured person seen from any camera, in a plain place (Xu et al. 2018, Fig. 8)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from perfcap.actor.template import Template
from perfcap.geometry.camera import Camera
from perfcap.io.video_writer import VideoWriter
from perfcap.pipeline.appearance import Appearance
from perfcap.pipeline.camera_path import CameraPath
from perfcap.pipeline.footage import Image
from perfcap.pipeline.surface import BLOCK, SurfaceFrames
from perfcap.pipeline.surroundings import Surroundings
from perfcap.render import ProjectedMesh, Visibility, render, shade_ground, visibility
from perfcap.render.backdrop import Backdrop
from perfcap.workers import ordered_map

# Directions that light is taken from; fewer than in still pictures, for speed.
_SUN, _SKY = 1, 12  # on the person
_SUN_BELOW, _SKY_BELOW = 4, 10  # on the ground


@dataclass(frozen=True)
class Studio:
    """Where and how a person is shown; everything but the moment and the camera."""

    appearance: Appearance
    around: Surroundings
    backdrop: Backdrop

    @classmethod
    def of(cls, template: Template, around: Surroundings, middle: Tensor) -> Studio:
        """The studio of an actor.

        Args:
            template: the textured mesh.
            around: up, ground and light.
            middle: point (3,) above or below the middle of the ground, m.
        """
        up, middle = around.up.double(), middle.double()
        ground = middle + (around.ground - middle @ up) * up
        return cls(Appearance.of(template), around, Backdrop(up, ground))

    def at(self, vertices: Tensor) -> Moment:
        """The person in one pose, template vertices (V, 3) m in the world."""
        return Moment(self, vertices[self.appearance.representative].float())


@dataclass(frozen=True, eq=False)
class Moment:
    """One pose in a studio, welded vertices (U, 3); seen again and again by a turntable."""

    studio: Studio
    vertices: Tensor

    @cached_property
    def reached(self) -> Visibility:
        """Share of the light that reaches the vertices."""
        studio = self.studio
        lighting = studio.around.lighting
        return visibility(self.vertices, studio.appearance.faces, lighting, _SUN, _SKY)

    def seen_by(self, camera: Camera) -> Image:
        """A picture (H, W, 3) by a camera of one view at one time, batch (1,)."""
        studio, faces = self.studio, self.studio.appearance.faces
        lighting, ground = studio.around.lighting, studio.around.ground
        empty, below = studio.backdrop.seen_by(camera)
        darker = shade_ground(
            empty, camera, self.vertices, faces, lighting, ground, _SUN_BELOW, _SKY_BELOW
        )
        behind = torch.where(below[..., None], darker, empty)
        mesh = ProjectedMesh.seen_by(camera, self.vertices, faces)
        drawn = render(mesh, studio.appearance.texture, behind, lighting, self.reached)
        picture: Image = drawn.image.numpy()
        return picture


def draw_free_view(
    template: Template, surface: SurfaceFrames, around: Surroundings, path: CameraPath
) -> Iterator[Image]:
    """Pictures (H, W, 3) of a capture along a camera path, drawn by all cores.

    Args:
        template: the textured mesh.
        surface: its vertices in every frame of the capture.
        around: up, ground and light, see ``Surroundings.around``.
        path: what to show from where.
    """
    first = surface[int(path.frames[0]) : int(path.frames[0]) + 1][0]
    studio = Studio.of(template, around, first.mean(0).cpu())
    tasks = zip(_moments(studio, surface, path), range(len(path)), strict=True)
    yield from ordered_map(lambda task: task[0].seen_by(path.camera(task[1])), tasks)


def save_free_view(
    file: Path,
    pictures: Iterator[Image],
    total: int,
    rate: float,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the pictures of ``draw_free_view`` as an H.264 video.

    Raises:
        InputError: the place cannot be written.
    """
    with VideoWriter(file, rate, crf=18) as writer:
        for done, picture in enumerate(pictures, 1):
            writer.write(picture)
            if progress is not None:
                progress(done, total)


def _moments(studio: Studio, surface: SurfaceFrames, path: CameraPath) -> Iterator[Moment]:
    """One pose a picture, read in blocks; the same object while the same frame is shown."""
    block, start, shown = torch.empty(0), 0, -1
    moment: Moment | None = None
    for frame in path.frames.tolist():
        if not start <= frame < start + len(block):
            start, block = frame, surface[frame : frame + BLOCK].cpu()
        if moment is None or frame != shown:
            moment, shown = studio.at(block[frame - start]), frame
        yield moment
