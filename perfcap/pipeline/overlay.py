"""The video with the captured person drawn on it: as an outline, or as the textured character."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from perfcap.geometry.camera import Camera
from perfcap.io.calibration.pixel_map import PixelMap
from perfcap.io.clip import Clip
from perfcap.pipeline.appearance import Appearance
from perfcap.pipeline.checkpoint import NOTHING, Kept
from perfcap.pipeline.footage import Image, Painter, write_footage
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surroundings import daylight, upright
from perfcap.render import OverlayStyle, ProjectedMesh, draw_overlay, rasterize, render

_STYLE = OverlayStyle(tint=0.12)
_DIMMED = (0.45 * np.arange(256)).astype(np.uint8)  # of each brightness, behind the character

Progress = Callable[[int, int], None]


def save_overlay(
    path: Path,
    performance: Performance,
    clip: Clip,
    pixel_map: PixelMap,
    progress: Progress | None = None,
    kept: Kept = NOTHING,
) -> None:
    """Write the input with outline, skeleton and detections; several views side by side.

    Args:
        path: of the video, H.264.
        performance: the capture of the clip's frames; its surface gives the outline.
        clip: the frames.
        pixel_map: from the clip's pixels to the calibration's.
        progress: called with (frames done, frames).
        kept: what is drawn already.
    """
    cameras = pixel_map.cameras(performance.cameras, clip.sizes)
    faces = torch.as_tensor(performance.actor.template.faces.copy())

    def prepare(span: slice) -> Painter:
        pixels, depth = projected(cameras.frames(span), performance.shown[span])
        joints = performance.actor.joints(performance.motion[span])
        points = cameras.frames(span).project(joints).double().numpy(force=True)
        seen = performance.detections.frames(span)
        detected = pixel_map.to_video(seen.joints2d).double().numpy(force=True)
        confidence = seen.confidence2d.double().numpy(force=True)

        def paint(frame: int, view: int, image: Image) -> Image:
            size = (image.shape[0], image.shape[1])
            drawn = rasterize(pixels[frame, view], depth[frame, view], faces, size)
            at = (frame, view)
            marks = (points[at], detected[at], confidence[at])
            return draw_overlay(image, drawn.mask.numpy(), *marks, _STYLE)

        return paint

    with torch.no_grad():
        write_footage(path, clip, performance.frames, prepare, progress, kept)


def save_textured(
    path: Path,
    performance: Performance,
    clip: Clip,
    pixel_map: PixelMap,
    progress: Progress | None = None,
    kept: Kept = NOTHING,
) -> None:
    """Write the textured character over the dimmed input; arguments as of ``save_overlay``."""
    cameras = pixel_map.cameras(performance.cameras, clip.sizes)
    appearance = Appearance.of(performance.actor.template)
    lighting = daylight(upright(performance.joints().cpu()))

    def prepare(span: slice) -> Painter:
        vertices = performance.shown[span].float().cpu()[:, appearance.representative]
        pixels, depth = projected(cameras.frames(span), vertices)

        def paint(frame: int, view: int, image: Image) -> Image:
            mesh = ProjectedMesh(
                vertices[frame],
                appearance.faces,
                pixels[frame, view],
                depth[frame, view],
                (image.shape[0], image.shape[1]),
            )
            behind = torch.from_numpy(_DIMMED[image])
            picture: Image = render(mesh, appearance.texture, behind, lighting).image.numpy()
            return picture

        return paint

    with torch.no_grad():
        write_footage(path, clip, performance.frames, prepare, progress, kept)


def projected(cameras: Camera, vertices: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels (f, C, V, 2) and depth (f, C, V) of vertices (f, V, 3), on the CPU."""
    local = cameras.to_camera(vertices.to(cameras.intrinsics))
    return cameras.project_camera(local).cpu(), local[..., 2].cpu()
