"""Coordinates of repeated images, brought into the one copy that a sheet of several images has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from perfcap.io.gltf_document import Document, Object

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

Wraps = tuple[int, int]  # how an image goes on along u and v, as glTF numbers it

REPEATED: Wraps = (10497, 10497)
_SLACK = 1e-3
_INSIDE = 1 / 512  # half a pixel of an image of 256, more of finer ones
_CLAMP_TO_EDGE, _MIRRORED_REPEAT = 33071, 33648


def wraps(document: Document, texture: Object) -> Wraps:
    """How a texture goes on beyond its image: it repeats where the file does not say."""
    if "sampler" not in texture:
        return REPEATED
    sampler = document.item("samplers", texture["sampler"])
    return sampler.get("wrapS", REPEATED[0]), sampler.get("wrapT", REPEATED[1])


def repeating(uv: Floats, axes: Wraps) -> Floats:
    """Coordinates (v, 2) that show in an image that repeats what these show in one that may not.

    Those beyond an image that ends at its edges are put on them, and those in the mirrored copies
    of one are folded back. Exact where no triangle crosses an edge, as of a character with one
    half painted.
    """
    moved = uv.copy()
    for axis, wrap in enumerate(axes):
        if wrap == _CLAMP_TO_EDGE:
            moved[:, axis] = ended(uv[:, axis])
        elif wrap == _MIRRORED_REPEAT:
            moved[:, axis] = np.abs(uv[:, axis] - 2 * np.round(uv[:, axis] / 2))
    return moved


def ended(uv: Floats) -> Floats:
    """Coordinates, any shape, on the edges of an image where they are beyond it.

    They are put just inside, since on the edge a repeating image blends with its other side.
    """
    return np.where((uv < 0) | (uv > 1), uv.clip(_INSIDE, 1 - _INSIDE), uv)


def in_one_tile(uv: Floats, faces: Integers | None) -> tuple[Floats, float]:
    """Coordinates within one copy of an image, each connected piece moved by whole copies.

    Args:
        uv: of the vertices, (v, 2).
        faces: of them, (t, 3), since buffers hold vertices of other parts, too; all are one piece
            without them.

    Returns:
        The coordinates, and the share of the triangles that span more than one copy, which show
        the image's edge instead.
    """
    used = np.arange(len(uv)) if faces is None or not len(faces) else np.unique(faces)
    pieces = np.zeros(len(uv), np.int64)
    count = 1
    if faces is not None and len(faces):
        ends = np.concatenate((faces[:, :2], faces[:, 1:]))
        links = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (len(uv), len(uv)))
        count, pieces = connected_components(links, directed=False)
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, pieces[used], uv[used])
    np.maximum.at(high, pieces[used], uv[used])
    seen = np.isfinite(low)
    middle = 0.5 * (np.where(seen, low, 0.0) + np.where(seen, high, 0.0))
    moved = uv - np.floor(middle)[pieces]
    outside = np.logical_or(moved < -_SLACK, moved > 1 + _SLACK)
    beyond = np.asarray(outside[:, 0] | outside[:, 1])
    wrong = beyond[used] if faces is None or not len(faces) else beyond[faces].max(-1)
    inside: Floats = np.clip(moved, 0.0, 1.0)
    return inside, float(np.mean(wrong)) if len(used) else 0.0
