"""A fitted body drawn over the frames it was fitted to."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.actor.body_model import BodyModel
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.app.fit_views import ChosenFrames
from perfcap.io.atomic import writing
from perfcap.render import OverlayStyle, draw_overlay, rasterize
from perfcap.rigging import BodyFit

Image = NDArray[np.uint8]

FIT_SHEET = "fit.jpg"
_FRAMES, _VIEWS = 3, 4  # at most
_SIZE = 360  # px, side of each picture
_ROOM = 0.65  # half a picture, over the person's size
_QUALITY = 88
_STYLE = OverlayStyle(tint=0.12)


def save_fit_sheet(path: Path, model: BodyModel, fit: BodyFit, chosen: ChosenFrames) -> None:
    """Draw outline, joints and detections of some frames, one a row, into a JPEG file."""
    encoded = cv2.imencode(
        ".jpg", fit_sheet(model, fit, chosen)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY]
    )[1]
    with writing(path) as file:
        file.write(encoded.tobytes())


@torch.no_grad()
def fit_sheet(model: BodyModel, fit: BodyFit, chosen: ChosenFrames) -> Image:
    """A row for each of three frames, a picture for each of at most four views, (H, W, 3) RGB."""
    actor = model.actor(torch.zeros(0)).to(chosen.detections.joints2d)
    surface = ShapedPoints.of_surface(model, actor)
    marks = ShapedPoints.of_landmarks(model, actor).at(np.arange(16))
    frames = sorted({int(f) for f in np.linspace(0, len(chosen) - 1, _FRAMES).round()})
    rows = []
    for frame in frames:
        motion = fit.motion[frame : frame + 1]
        cameras = chosen.cameras.frames(slice(frame, frame + 1))
        local = cameras.to_camera(surface(motion))
        pixels, depth = cameras.project_camera(local)[0], local[0, ..., 2]
        points = cameras.project(marks(motion))[0].double().numpy()
        row = []
        for view in range(min(cameras.views, _VIEWS)):
            faces = torch.from_numpy(model.rig.faces)
            drawn = rasterize(pixels[view], depth[view], faces, cameras.size[view])
            seen = chosen.detections.joints2d[frame, view].numpy()
            sure = chosen.detections.confidence2d[frame, view].numpy()
            image = chosen.read_view(view, frame, frame + 1)[0]
            picture = draw_overlay(image, drawn.mask.numpy(), points[view], seen, sure, _STYLE)
            row.append(_around(picture, points[view]))
        rows.append(np.concatenate(row, 1))
    return np.concatenate(rows)


def _around(picture: Image, points: NDArray[np.float64]) -> Image:
    """The square about a person's joints (16, 2) px, black beyond the image."""
    low, high = points.min(0), points.max(0)
    middle, half = (low + high) / 2, _ROOM * float((high - low).max())
    scale = _SIZE / (2 * half)
    shift = _SIZE / 2 - scale * middle
    matrix = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    small = cv2.GaussianBlur(picture, (0, 0), 0.4 / scale) if scale < 0.7 else picture
    square: Image = cv2.warpAffine(small, matrix, (_SIZE, _SIZE)).astype(np.uint8)
    return square
