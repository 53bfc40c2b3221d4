"""A small triangle rasteriser: texture baking, and pictures to look at."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@numba.njit(cache=False)
def rasterize(corners: Floats, height: int, width: int) -> tuple[Integers, Floats]:
    """Nearest triangle and barycentric coordinates at each pixel centre.

    Args:
        corners: (T, 3, 3) pixel x, pixel y and depth; smaller depth wins.
        height: rows.
        width: columns.

    Returns:
        Triangle index or -1, (height, width), and barycentrics (height, width, 3).
    """
    index = np.full((height, width), -1, dtype=np.int64)
    share = np.zeros((height, width, 3))
    nearest = np.full((height, width), np.inf)
    for t in range(len(corners)):
        (x0, y0, z0), (x1, y1, z1), (x2, y2, z2) = corners[t]
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if area == 0.0:
            continue
        left, right = max(0, int(min(x0, x1, x2))), min(width - 1, int(max(x0, x1, x2)) + 1)
        top, bottom = max(0, int(min(y0, y1, y2))), min(height - 1, int(max(y0, y1, y2)) + 1)
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                b0 = ((x1 - x) * (y2 - y) - (x2 - x) * (y1 - y)) / area
                b1 = ((x2 - x) * (y0 - y) - (x0 - x) * (y2 - y)) / area
                b2 = 1.0 - b0 - b1
                depth = b0 * z0 + b1 * z1 + b2 * z2
                if min(b0, b1, b2) >= -1e-9 and depth < nearest[y, x]:
                    nearest[y, x] = depth
                    index[y, x] = t
                    share[y, x] = (b0, b1, b2)
    return index, share


def picture(
    vertices: Floats,
    faces: Integers,
    uv: Floats,
    texture: NDArray[np.uint8],
    turn: float,
    frame: tuple[float, float, float, float],
    height: int,
) -> NDArray[np.uint8]:
    """Orthographic view of a textured mesh with a soft light from the viewer's upper left.

    Args:
        vertices: (V, 3) m, y up.
        faces: (T, 3).
        uv: (V, 2), origin at the top left.
        texture: (H, W, 3).
        turn: rotation of the person about y in degrees; 0 looks at the front.
        frame: left, right, bottom, top of the view in metres.
        height: rows of the picture, which is supersampled twice.
    """
    left, right, bottom, top = frame
    rows = 2 * height
    scale = rows / (top - bottom)
    columns = 2 * round((right - left) * scale / 2)
    angle = np.radians(turn)
    rotation = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    turned = vertices @ rotation.T
    pixels = np.stack(
        [(turned[:, 0] - left) * scale, (top - turned[:, 1]) * scale, -turned[:, 2]], axis=1
    )
    index, share = rasterize(pixels[faces], rows, columns)
    corners = faces[index]
    spot = (uv[corners] * share[..., None]).sum(2)
    color = sample(texture, spot)
    normals = _normals(turned, faces)
    normal = (normals[corners] * share[..., None]).sum(2)
    light = np.clip(normal @ np.array([-0.35, 0.55, 0.76]), 0, 1)
    shaded = color * (0.62 + 0.42 * light[..., None])
    image = np.where((index >= 0)[..., None], shaded, 236.0)
    image = image.reshape(height, 2, columns // 2, 2, 3).mean((1, 3))
    return np.clip(image, 0, 255).astype(np.uint8)


def sample(texture: NDArray[np.uint8], spot: Floats) -> Floats:
    """Bilinear texture values at coordinates with the origin at the top left."""
    size = np.array([texture.shape[1], texture.shape[0]])
    place = np.clip(spot * size - 0.5, 0, size - 1.001)
    low = place.astype(int)
    part = place - low
    total = np.zeros((*spot.shape[:-1], texture.shape[2] if texture.ndim == 3 else 1))
    image = texture if texture.ndim == 3 else texture[..., None]
    for dy in (0, 1):
        for dx in (0, 1):
            weight = np.abs(1 - dx - part[..., 0]) * np.abs(1 - dy - part[..., 1])
            total += weight[..., None] * image[low[..., 1] + dy, low[..., 0] + dx]
    return total


def _normals(vertices: Floats, faces: Integers) -> Floats:
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Texture seams split vertices; sum over those at one place.
    _, place = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    place = place.reshape(-1)
    total = np.zeros((place.max() + 1, 3))
    np.add.at(total, place[faces], area[:, None])
    normals = total[place]
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
