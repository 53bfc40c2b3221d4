"""Pictures of contours: the volume over each view, its contour on the image's edges, the energy."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from report import RESULTS

from perfcap.actor.volume import GaussianCentres
from perfcap.pipeline.performance import Performance
from perfcap.render.density import Splats, background
from perfcap.segment.edge_field import EdgeField, find_edges


def save_pictures(seen: Any, found: Performance, name: str) -> None:
    """One picture for the middle frame: a column a view.

    Rows: the volume as a soft blob; green the contour, red the edges (yellow where they meet);
    what each pixel adds to the energy, blue gains and red costs.
    """
    assert found.contours is not None
    frame = found.frames // 2
    volume, cameras = found.contours.volume, seen.images.cameras
    points = GaussianCentres(found.actor.skeleton, volume)(found.motion[frame : frame + 1])
    splats = Splats.seen_by(cameras, points, volume.deviations, volume.densities)
    columns = []
    for view in range(cameras.views):
        (image,) = seen.images.reader.read_view(view, frame, frame + 1)
        one = splats.map(lambda each, view=view: each[0, view])
        left, slope = background(one, image.shape[:2])
        column = _column(image, left.numpy(), slope.numpy(), find_edges(image))
        middle = one.centre.mean(0).numpy()
        columns.append(_cropped(column, middle))
    height = min(len(each) for each in columns)
    sheet = np.concatenate([each[:height] for each in columns], 1)
    RESULTS.mkdir(exist_ok=True)
    cv2.imwrite(str(RESULTS / f"contours_{name}.png"), sheet[..., ::-1])


def _column(
    image: NDArray[np.uint8], left: NDArray[Any], slope: NDArray[Any], field: EdgeField
) -> list[NDArray[np.uint8]]:
    share = (1 - left)[..., None]
    blob = image * (1 - 0.7 * share) + 0.7 * share * np.array([255, 120, 30])
    size = np.hypot(*slope)
    strength = np.hypot(*field.edges)
    lines = np.stack((strength / 0.2, size / 0.35, 0 * size), -1) * 255
    x, y = slope / np.maximum(size, 1e-9)
    alike = field.edges[0] * (x * x - y * y) + 2 * field.edges[1] * x * y
    energy = size * (field.flat - alike) / 0.05
    map_ = np.stack((energy, 0 * energy, -energy), -1) * 255
    return [np.clip(each, 0, 255).astype(np.uint8) for each in (blob, lines, map_)]


def _cropped(column: list[NDArray[np.uint8]], middle: NDArray[Any]) -> NDArray[np.uint8]:
    width = column[0].shape[1]
    half = int(0.19 * width)
    x = int(np.clip(middle[0], half, width - half))
    return np.concatenate([each[:, x - half : x + half] for each in column])
