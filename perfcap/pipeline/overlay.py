"""The video with the captured people drawn on it: as outlines, or as the textured character."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.calibration.pixel_map import PixelMap
from perfcap.io.clip import END_SLACK, Clip
from perfcap.pipeline.appearance import Appearance
from perfcap.pipeline.checkpoint import NOTHING, Kept
from perfcap.pipeline.footage import Image, Painter, write_footage
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surroundings import daylight
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

    Raises:
        InputError: the clip has other frames or views than the capture, or the place cannot be
            written.
    """
    frames = _frames_of([performance], clip)
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
        write_footage(path, clip, frames, prepare, progress, kept)


def save_textured(
    path: Path,
    performance: Performance,
    clip: Clip,
    pixel_map: PixelMap,
    progress: Progress | None = None,
    kept: Kept = NOTHING,
) -> None:
    """Write the textured character over the dimmed input; arguments as of ``save_overlay``."""
    frames = _frames_of([performance], clip)
    cameras = pixel_map.cameras(performance.cameras, clip.sizes)
    appearance = Appearance.of(performance.actor.template)
    lighting = daylight(performance.upward.cpu())

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
        write_footage(path, clip, frames, prepare, progress, kept)


def projected(cameras: Camera, vertices: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels (f, C, V, 2) and depth (f, C, V) of vertices (f, V, 3), on the CPU."""
    local = cameras.to_camera(vertices.to(cameras.intrinsics))
    return cameras.project_camera(local).cpu(), local[..., 2].cpu()


# --- The video with everybody drawn on it, each person in a colour of their own -------------------

COLORS = (
    (255, 214, 60), (232, 90, 210), (80, 220, 230), (120, 220, 90),
    (255, 140, 60), (150, 140, 255), (250, 250, 250), (200, 60, 70),
)  # fmt: skip
"""Of people in turn, RGB; told apart by those who see no red or no green, too, in this order."""


def person_style(number: int) -> OverlayStyle:
    """Looks of person ``number``, counted from 0: their own colour, darker on the left side."""
    color = COLORS[number % len(COLORS)]
    red, green, blue = (round(0.6 * part) for part in color)
    return OverlayStyle(
        outline=color, tint=0.15, right=color, left=(red, green, blue), middle=color,
        detection=color, stick_width=2.6,
    )  # fmt: skip


def save_people_overlay(
    path: Path,
    people: Sequence[Performance],
    clip: Clip,
    pixel_map: PixelMap,
    progress: Progress | None = None,
    kept: Kept = NOTHING,
) -> None:
    """Write the input with everybody's outline, skeleton and detections; views side by side.

    Outlines end where somebody nearer begins; skeletons of those behind are drawn first.

    Args:
        path: of the video, H.264.
        people: captures of the clip's frames in the same views.
        clip: the frames.
        pixel_map: from the clip's pixels to the calibration's.
        progress: called with (frames done, frames).
        kept: what is drawn already.

    Raises:
        InputError: the clip has other frames or views than the captures, or the place cannot be
            written.
    """
    frames = _frames_of(people, clip)
    cameras = pixel_map.cameras(people[0].cameras, clip.sizes)
    faces, owner = _joined_faces(people)

    def prepare(span: slice) -> Painter:
        seen = cameras.frames(span)
        parts = [projected(seen, each.shown[span]) for each in people]
        pixels, depth = (torch.cat(each, 2) for each in zip(*parts, strict=True))
        joints = [each.actor.joints(each.motion[span]) for each in people]
        far = torch.stack([seen.to_camera(j)[..., 2].mean(-1) for j in joints]).numpy(force=True)
        points = [seen.project(each).double().numpy(force=True) for each in joints]
        detections = [each.detections.frames(span) for each in people]
        detected = [pixel_map.to_video(d.joints2d).double().numpy(force=True) for d in detections]
        trust = [d.confidence2d.double().numpy(force=True) for d in detections]

        def paint(frame: int, view: int, image: Image) -> Image:
            at = (frame, view)
            size = (image.shape[0], image.shape[1])
            labels = rasterize(pixels[at], depth[at], faces, size).label(owner, -1).numpy()
            picture = image
            for k in np.argsort(-far[:, frame, view]):
                marks = (points[k][at], detected[k][at], trust[k][at])
                picture = draw_overlay(picture, labels == k, *marks, person_style(int(k)))
            return picture

        return paint

    with torch.no_grad():
        write_footage(path, clip, frames, prepare, progress, kept)


def _frames_of(people: Sequence[Performance], clip: Clip) -> int:
    """How many frames are drawn, where the clip is the one that was captured."""
    frames = min(each.frames for each in people)
    views = people[0].cameras.views
    if clip.views != views or not 0 <= len(clip) - frames <= END_SLACK:
        raise InputError(
            f"clip: is {len(clip)} frames of {clip.views} views, and the capture {frames} of "
            f"{views}; expected the clip that was captured: Clip.open(paths, frames=slice(A, B)) "
            "opens a part of its videos"
        )
    return frames


def _joined_faces(people: Sequence[Performance]) -> tuple[Tensor, Tensor]:
    """Faces of all people as one mesh (T, 3), and whose each is (T,)."""
    faces, owner, first = [], [], 0
    for number, each in enumerate(people):
        own = torch.as_tensor(each.actor.template.faces.copy()) + first
        faces.append(own)
        owner.append(torch.full((len(own),), number))
        first += len(each.actor.template.vertices)
    return torch.cat(faces), torch.cat(owner)
