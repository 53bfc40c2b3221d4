"""The video with the captured person drawn on it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.geometry.camera import Camera
from perfcap.io.calibration.pixel_map import PixelMap
from perfcap.io.clip import Clip
from perfcap.io.video_writer import VideoWriter
from perfcap.pipeline.performance import Performance
from perfcap.render import OverlayStyle, draw_overlay, rasterize

_BATCH = 16  # frames in memory at once
_TALLEST, _WIDEST = 1080, 1920  # of the written video, pixels
_STYLE = OverlayStyle(tint=0.12)

Image = NDArray[np.uint8]


def save_overlay(
    path: Path,
    performance: Performance,
    clip: Clip,
    pixel_map: PixelMap,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the input with outline, skeleton and detections; several views side by side.

    Args:
        path: of the video, H.264.
        performance: the capture of the clip's frames.
        clip: the frames.
        pixel_map: from the clip's pixels to the calibration's.
        progress: called with (frames done, frames).
    """
    total = min(len(clip), performance.frames)
    done = 0
    with VideoWriter(path, clip.fps, crf=21) as writer:
        for views in clip.iter_views(_BATCH):
            count = min(len(views[0]), total - done)
            for row in _draw(performance, pixel_map, [v[:count] for v in views], done):
                writer.write(_fit(row))
            done += count
            if progress is not None:
                progress(done, total)
            if done >= total:
                break


def _draw(
    performance: Performance, pixel_map: PixelMap, views: list[Image], start: int
) -> list[Image]:
    """Frames ``start ...`` of all views, drawn on, one picture a frame."""
    span = slice(start, start + len(views[0]))
    motion = performance.motion[span]
    actor, cameras = performance.actor, performance.cameras.frames(span)
    with torch.no_grad():
        vertices = actor.surface(motion)  # F V 3
        points = cameras.project(actor.joints(motion)).transpose(0, 1)  # C F 16 2
        seen = performance.detections.frames(span)
        detected = seen.joints2d.transpose(0, 1)
        points, detected = (
            pixel_map.to_video(p.flatten(1, 2)).reshape(p.shape) for p in (points, detected)
        )
    faces = torch.as_tensor(actor.template.faces.copy())
    rows: list[list[Image]] = [[] for _ in range(motion.angles.shape[0])]
    for view, frames in enumerate(views):
        masks = _masks(cameras, view, vertices, faces, pixel_map, frames.shape[1:3])
        for index, frame in enumerate(frames):
            picture = draw_overlay(
                frame,
                masks[index].numpy(),
                points[view, index].double().numpy(force=True),
                detected[view, index].double().numpy(force=True),
                seen.confidence2d[index, view].double().numpy(force=True),
                _STYLE,
            )
            rows[index].append(picture)
    return [_side_by_side(row) for row in rows]


def _masks(
    cameras: Camera,
    view: int,
    vertices: Tensor,
    faces: Tensor,
    pixel_map: PixelMap,
    size: tuple[int, ...],
) -> Tensor:
    """Silhouettes of the posed mesh in the pixels of a view's video, (F, H, W)."""
    camera = cameras.select([view])
    local = camera.to_camera(vertices)  # F 1 V 3
    pixels = camera.project_camera(local)[:, 0]
    flat = pixels.new_zeros(len(pixel_map.matrices), pixels.shape[0] * pixels.shape[1], 2)
    flat[view] = pixels.flatten(0, 1)
    in_video = pixel_map.to_video(flat)[view].reshape(pixels.shape)
    return rasterize(in_video, local[:, 0, :, 2], faces, (size[0], size[1])).mask


def _side_by_side(pictures: list[Image]) -> Image:
    if len(pictures) == 1:
        return pictures[0]
    height = min(picture.shape[0] for picture in pictures)
    scaled = [
        cv2.resize(
            p, (round(p.shape[1] * height / p.shape[0]), height), interpolation=cv2.INTER_AREA
        )
        for p in pictures
    ]
    joined: Image = np.concatenate(scaled, 1)
    return joined


def _fit(picture: Image) -> Image:
    """Shrunk to what a screen shows; never enlarged."""
    height, width = picture.shape[:2]
    scale = min(1.0, _TALLEST / height, _WIDEST / width)
    if scale == 1.0:
        return picture
    size = (round(width * scale), round(height * scale))
    shrunk: Image = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return shrunk
