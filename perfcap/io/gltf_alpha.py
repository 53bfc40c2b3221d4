"""How much of a part of a character is drawn see-through: an actor's faces are all solid."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import image_mime
from perfcap.io.gltf_document import Document, Object
from perfcap.io.gltf_texture import LARGEST_AREA, LARGEST_SIDE, painted_by, read_material
from perfcap.io.image_file import image_size

Floats = NDArray[np.float64]

_SEEN = 0.5  # of alpha, where a material blends; others say their cutoff
_SAMPLES = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / ([[3], [6], [6], [6]])


def hidden_area(
    document: Document, primitive: Object, corners: Floats, coordinates: Floats | None
) -> float:
    """Area of a primitive that is hardly drawn, by the alpha of its material, m².

    Args:
        document: the file.
        primitive: of it.
        corners: of its triangles, (T, 3, 3), metres.
        coordinates: of their texture, (T, 3, 2) with the origin at the top left; or None.
    """
    if "material" not in primitive:
        return 0.0
    material = document.item("materials", primitive["material"])
    if material.get("alphaMode") not in ("MASK", "BLEND"):
        return 0.0
    (cutoff,) = document.numbers([material.get("alphaCutoff", _SEEN)], 1, "alphaCutoff")
    factor = float(painted_by(document, material)[0][3])
    number = read_material(document, primitive)[0].image
    alpha = np.ones((1, 1))
    if number is not None and coordinates is not None:
        alpha = _alpha(document.image(number))
    places = _SAMPLES @ (np.zeros((len(corners), 3, 2)) if coordinates is None else coordinates)
    size = np.array(alpha.shape[::-1])
    column, row = np.moveaxis(((places - np.floor(places)) * size).astype(int), -1, 0)
    hidden = factor * alpha[row.clip(max=size[1] - 1), column.clip(max=size[0] - 1)] < cutoff
    sides = corners[:, 1:] - corners[:, :1]
    areas = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=-1)
    return float(areas @ hidden.mean(1))


def _alpha(data: bytes) -> Floats:
    """Alpha of an encoded image, (H, W) in 0 to 1; ones where it has none, or is not read."""
    size = image_size(data) if image_mime(data) is not None else None
    if size is None or max(size) > LARGEST_SIDE or size[0] * size[1] > LARGEST_AREA:
        return np.ones((1, 1))
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim < 3 or image.shape[2] < 4:
        return np.ones((1, 1))
    return np.asarray(image[..., 3] / np.iinfo(image.dtype).max, np.float64)
