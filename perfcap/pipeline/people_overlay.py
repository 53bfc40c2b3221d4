"""The video with everybody drawn on it, each person in a colour of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from perfcap.io.calibration.pixel_map import PixelMap
from perfcap.io.clip import Clip
from perfcap.pipeline.checkpoint import NOTHING, Kept
from perfcap.pipeline.footage import Image, Painter, write_footage
from perfcap.pipeline.overlay import Progress, projected
from perfcap.pipeline.performance import Performance
from perfcap.render import OverlayStyle, draw_overlay, rasterize

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
    """
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
        frames = min(each.frames for each in people)
        write_footage(path, clip, frames, prepare, progress, kept)


def _joined_faces(people: Sequence[Performance]) -> tuple[Tensor, Tensor]:
    """Faces of all people as one mesh (T, 3), and whose each is (T,)."""
    faces, owner, first = [], [], 0
    for number, each in enumerate(people):
        own = torch.as_tensor(each.actor.template.faces.copy()) + first
        faces.append(own)
        owner.append(torch.full((len(own),), number))
        first += len(each.actor.template.vertices)
    return torch.cat(faces), torch.cat(owner)
