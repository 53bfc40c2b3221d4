"""Parts of a character that are drawn see-through: an actor's faces are all solid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import image_mime
from perfcap.geometry.surface_topology import face_areas
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.gltf_document import Document
from perfcap.io.gltf_part import Part
from perfcap.io.image_file import image_size
from perfcap.io.texture_file import LARGEST_AREA, LARGEST_SIDE

Floats = NDArray[np.float64]
Alpha = NDArray[np.uint8] | NDArray[np.uint16]

_MOST = 0.01  # of the surface, more than lashes and the like
# where the alpha of a triangle is looked at: its middle, and near each corner
_PLACES = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / ([[3], [6], [6], [6]])
_OPAQUE = np.full((1, 1), 255, np.uint8)


def see_through(
    document: Document, parts: Sequence[Part], *, metres: bool = True
) -> Iterator[Finding]:
    """Parts of which much is not drawn, as hair of cards with strands painted on them.

    Args:
        document: the file.
        parts: of it.
        metres: whether it is in metres; if not, areas are given as shares.
    """
    kinds: dict[int | None, list[Part]] = {}
    for part in parts:
        if part.blend is not None:
            kinds.setdefault(None if part.uv is None else part.material.image, []).append(part)
    if not kinds:
        return
    whole = sum(float(face_areas(part.vertices, part.faces).sum()) for part in parts)
    for number, some in kinds.items():  # each image is decoded once
        alpha = _OPAQUE if number is None else _alpha(document.image(number))
        for part in some:
            hidden = _hidden_area(part, alpha)
            if hidden > _MOST * whole:
                size = (
                    f"{hidden:.2g} m² of its faces"
                    if metres
                    else f"faces that make up {hidden / whole:.0%} of all"
                )
                yield Finding(
                    Severity.WARNING,
                    part.name,
                    f"{size} are transparent, and count as solid: in silhouettes the person is "
                    "larger there, and results show it",
                    "model what is seen, or leave the part out",
                )


def _hidden_area(part: Part, alpha: Alpha) -> float:
    """Area of a part that is hardly drawn, by the alpha (H, W) of its image."""
    assert part.blend is not None
    hidden = np.zeros(len(part.faces))
    height, width = alpha.shape
    uv = np.zeros((len(part.vertices), 2)) if part.uv is None else part.uv
    for place in _PLACES:
        at = np.einsum("k,tki->ti", place, uv[part.faces])
        column, row = ((at - np.floor(at)) * (width, height)).astype(int).T
        share = (
            alpha[row.clip(max=height - 1), column.clip(max=width - 1)] / np.iinfo(alpha.dtype).max
        )
        hidden += part.blend.factor * share < part.blend.cutoff
    return float(face_areas(part.vertices, part.faces) @ hidden) / len(_PLACES)


def _alpha(data: bytes) -> Alpha:
    """Alpha of an encoded image, (H, W); opaque where it has none, or is not read."""
    size = image_size(data) if image_mime(data) is not None else None
    if size is None or max(size) > LARGEST_SIDE or size[0] * size[1] > LARGEST_AREA:
        return _OPAQUE
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim < 3 or image.shape[2] < 4:
        return _OPAQUE
    return np.ascontiguousarray(image[..., 3])
