"""How far the boundary of a mask can be trusted, point by point.

The confidence is the probability that the true boundary is within half a percent of the person's
size, from what the colours on both sides say, how strong the edge is, and how far the model had
it. Its weights are those that `experiments/boundary_trust.py` fits to the demo clip, to noise in
its place, and to masks of a real man that were drawn by hand; rounded.
Where the boundary runs along the limit of what was looked at, it is no measurement at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment.grabcut import Segmentation
from perfcap.segment.trimap import Trimap
from perfcap.setting_checks import Settings

Floats = NDArray[np.float64]
Plane = NDArray[np.float32]

_BESIDE = (1.5, 2.5, 3.5)  # px from the boundary, where evidence is looked at
_LIMIT = 2.0  # px from the boundary at which labels must be open
_NATS = (-4.0, 12.0, 8.0)  # of evidence: least, most inside, most outside
_CONTRAST = (5.0, 150.0)  # grey levels: least, most
_EDGE = 50.0  # grey levels that count as an edge
_FAR = 4.0  # percent of the person's size: departures from the model beyond it are all alike


@dataclass(frozen=True)
class TrustSettings(Settings):
    """Weights of a logistic regression.

    Attributes:
        inside: per nat in favour of the person just inside the boundary.
        outside: per nat against the person just outside.
        contrast: per e-fold of the colour difference across the boundary over 50 grey levels.
        departure: per percent of the person's size between boundary and model, four at most.
        offset: the rest.
    """

    inside: float = 0.24
    outside: float = 0.26
    contrast: float = 0.4
    departure: float = -0.3
    offset: float = -0.35


def boundary_trust(
    found: Segmentation, points: Floats, normals: Floats, settings: TrustSettings | None = None
) -> Floats:
    """Confidence in points on the boundary of a mask, (N,) in [0, 1].

    Args:
        found: the segmentation that the mask is of.
        points: (N, 2) px of the image.
        normals: (N, 2) unit, outward.
        settings: weights.
    """
    settings = settings or TrustSettings()
    if not len(points) or not found.evidence.size:
        return np.zeros(len(points))
    weights = (settings.inside, settings.outside, settings.contrast, settings.departure)
    score = boundary_clues(found, points, normals) @ np.array(weights) + settings.offset
    at = points - [found.trimap.box[1].start, found.trimap.box[0].start]
    trust: Floats = _measured(found.trimap, at, normals) / (1 + np.exp(-score))
    return trust


def boundary_clues(found: Segmentation, points: Floats, normals: Floats) -> Floats:
    """What the weights of ``TrustSettings`` are multiplied with, in their order, (N, 4)."""
    trimap = found.trimap
    at = points - [trimap.box[1].start, trimap.box[0].start]
    inside = np.mean([_sample(found.evidence, at - k * normals) for k in _BESIDE], 0)
    outside = np.mean([_sample(found.evidence, at + k * normals) for k in _BESIDE], 0)
    contrast = np.clip(_contrast(found.image, at, normals), *_CONTRAST)
    departure = np.abs(_sample(trimap.distance, at)) / (0.01 * trimap.size)
    clues = (
        np.clip(inside, _NATS[0], _NATS[1]),
        np.clip(-outside, _NATS[0], _NATS[2]),
        np.log(contrast / _EDGE),
        np.minimum(departure, _FAR),
    )
    return np.stack(clues, 1)


def _contrast(image: NDArray[np.uint8], at: Floats, normals: Floats) -> Floats:
    """Colour difference across the boundary."""
    sides: Sequence[Floats] = [_sample(image, at + side * _BESIDE[0] * normals) for side in (-1, 1)]
    difference: Floats = np.linalg.norm(sides[0] - sides[1], axis=-1)
    return difference


def _measured(trimap: Trimap, at: Floats, normals: Floats) -> Floats:
    """One where both sides of the boundary were open, zero at the limits of the band."""
    band = trimap.band.astype(np.float32)
    sides = [_sample(band, at + side * _LIMIT * normals) for side in (-1, 1)]
    distance = _sample(trimap.distance, at)
    room = np.minimum(distance + trimap.outer, trimap.inner - distance)
    open_: Floats = np.minimum(*sides) * np.clip(room / _LIMIT, 0, 1)
    return open_


def _sample(plane: NDArray[np.generic], at: Floats) -> Floats:
    """Bilinear values of a picture (h, w, ...) at points (N, 2), (N, ...)."""
    columns, rows = at.astype(np.float32).T[:, None]
    values = [  # remap takes at most 32767 points in a row
        cv2.remap(plane, c, r, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
        for c, r in zip(_pieces(columns), _pieces(rows), strict=True)
    ]
    return np.concatenate(values).astype(np.float64)


def _pieces(row: Plane) -> list[Plane]:
    return [row[:, i : i + 32000] for i in range(0, row.shape[1], 32000)]
