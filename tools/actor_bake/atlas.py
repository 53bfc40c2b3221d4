"""Places for the texture islands: the face gets the pixels, cloth makes do with less."""

from __future__ import annotations

import numpy as np
from actor_bake.assets import Body
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Cell of each island in the atlas: left, bottom, width, height; the origin is at the bottom left.
_CELLS = (
    (0.005, 0.465, 0.500, 0.530),  # torso with limbs
    (0.515, 0.205, 0.480, 0.790),  # head
    (0.005, 0.245, 0.215, 0.210),  # hands
    (0.225, 0.245, 0.215, 0.210),
    (0.450, 0.355, 0.055, 0.095),  # ankles
    (0.450, 0.250, 0.055, 0.095),
    (0.515, 0.010, 0.180, 0.180),  # eyeballs
    (0.705, 0.010, 0.180, 0.180),
    (0.005, 0.010, 0.240, 0.225),  # shoes
    (0.255, 0.010, 0.240, 0.225),
)
_FACE = np.array([0.872, 0.482])  # between eyes and mouth, in the original coordinates
_ZOOM, _REACH = 1.2, 0.07  # the face grows by 1 + _ZOOM; below 1.24 + 1 the map stays one-to-one


def arrange(body: Body) -> Floats:
    """New texture coordinates of the same corners, (N, 2), origin at the bottom left."""
    uv = body.uv.copy()
    for number, cell in enumerate(_CELLS):
        if not (body.island == number).any():  # a barefoot body has no shoes
            continue
        corners = np.unique(body.face_uv[body.island == number])
        island = _magnify_face(body.uv[corners]) if number == 1 else body.uv[corners]
        low, size = island.min(0), np.ptp(island, axis=0)
        room = np.array(cell[2:])
        scale = (room / size).min()
        uv[corners] = cell[:2] + 0.5 * (room - scale * size) + scale * (island - low)
    return uv


def _magnify_face(uv: Floats) -> Floats:
    """A fisheye on the face: eyes and mouth are small in the original layout."""
    offset = uv - _FACE
    distance = np.linalg.norm(offset, axis=1, keepdims=True)
    magnified: Floats = _FACE + offset * (1 + _ZOOM * np.exp(-((distance / _REACH) ** 2)))
    return magnified
