"""The binary random field over the uncertain band (Rother et al. 2004; Xu 2018, Sec. 5.1).

Energy of a labelling: for each pixel the nats by which its evidence speaks against its label, and
for each pair of neighbours with different labels

    (contrast exp(-|c_i - c_j|^2 / 2 mean) + temporal exp(-max(m_i, m_j)^2)) / |i - j|

with colours c and temporal gradients m in units of the background's: neighbours that hardly
changed since the adjacent frame tend to share a label.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.segment import _random_field_numba
from perfcap.segment.min_cut import solve_min_cut
from perfcap.segment.trimap import FOREGROUND, PROBABLE_BACKGROUND, Trimap, bounds

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]

_UNIT = 256.0  # integer capacity of a nat
_MOST = 200.0  # nats; keeps capacities and their sums within 32 bits


@dataclass(frozen=True)
class Smoothness:
    """Weights of neighbouring pixels with different labels.

    Attributes:
        contrast: nats of neighbours of equal colour.
        temporal: nats of neighbours that did not change in time.
    """

    contrast: float = 6.0
    temporal: float = 10.0


def solve_field(
    trimap: Trimap,
    image: Plane,
    evidence: Plane,
    smoothness: Smoothness,
    motion: Plane | None = None,
) -> Mask:
    """The labelling of least energy.

    Args:
        trimap: of the person.
        image: colours (h, w, 3) of the trimap's box.
        evidence: nats in favour of foreground, (h, w); used where the trimap is open.
        smoothness: of the labels.
        motion: temporal gradient over its scale, (h, w).

    Returns:
        Foreground inside the trimap's box, (h, w).
    """
    foreground: Mask = trimap.labels == FOREGROUND
    part = bounds(trimap.band, 1)  # open pixels and their neighbours: others have no say
    labels = np.ascontiguousarray(trimap.labels[part])
    image = np.ascontiguousarray(image[part], np.float32)
    motion = None if motion is None else motion[part]
    band: Mask = labels >= PROBABLE_BACKGROUND
    count = int(band.sum())
    node = np.full(labels.shape, -1, np.int32)
    node[band] = np.arange(count, dtype=np.int32)
    neighbor = np.full((count, 8), -1, np.int32)
    capacity = np.zeros((count, 8), np.int32)
    excess = np.zeros(count, np.int32)
    spread = _random_field_numba.mean_contrast(labels, image)
    temporal = smoothness.temporal if motion is not None else 0.0
    _random_field_numba.connect(
        labels,
        image,
        np.zeros((0, 0), np.float32) if motion is None else np.exp(-motion * motion),
        np.clip(evidence[part], -_MOST, _MOST).astype(np.float32),
        (smoothness.contrast, temporal, 1 / (2 * max(spread, 1e-6))),
        _UNIT,
        node,
        neighbor,
        capacity,
        excess,
    )
    foreground[part][band], _ = solve_min_cut(neighbor, capacity, excess)
    return foreground
