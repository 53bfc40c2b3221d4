"""Colours of vertices as a texture, without splitting a vertex."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SIDE = 256  # px of the texture
_MARGIN = 0.02  # of it, left around the colours


def colors_to_texture(colors: NDArray[np.uint8]) -> tuple[Floats, bytes]:
    """Texture coordinates (V, 2), origin at the top left, and a PNG, for RGB colours (V, 3).

    The texture is the plane through the colours that lies nearest to them, in linear units of the
    texture, so that colours between vertices are interpolated as if they were the vertices' own.
    What lies off the plane is lost: little, as colours of one person mostly differ in brightness
    and along one more axis.
    """
    values = colors.astype(np.float64)
    middle = values.mean(0)
    axes = np.linalg.svd(values - middle, full_matrices=False)[2][:2]
    places = (values - middle) @ axes.T
    low, extent = places.min(0), np.maximum(np.ptp(places, axis=0), 1.0)
    uv = _MARGIN + (1 - 2 * _MARGIN) * (places - low) / extent
    along = ((np.arange(_SIDE) + 0.5) / _SIDE - _MARGIN) / (1 - 2 * _MARGIN)
    u, v = (low[k] + extent[k] * along for k in range(2))
    plane = middle + u[None, :, None] * axes[0] + v[:, None, None] * axes[1]
    image = plane.round().clip(0, 255).astype(np.uint8)
    return uv, cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1].tobytes()
