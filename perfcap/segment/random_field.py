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

from perfcap.array_checks import require_shape
from perfcap.errors import InputError
from perfcap.segment import _random_field_numba
from perfcap.segment.min_cut import MinCut
from perfcap.segment.trimap import FOREGROUND, PROBABLE_BACKGROUND, Trimap, bounds
from perfcap.setting_checks import Settings

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]

_UNIT = 256.0  # integer capacity of a nat
_MOST = 200.0  # nats; keeps capacities and their sums within 32 bits


@dataclass(frozen=True)
class Smoothness(Settings):
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
    return BandField(trimap, image, smoothness, motion).solve(evidence)


class BandField:
    """The field of one image, for evidence that changes; see ``solve_field``.

    What neighbours say to each other is computed once, and only around the open band.

    Raises:
        InputError: arrays of other shapes than the trimap's, or what is no number.
    """

    def __init__(
        self, trimap: Trimap, image: Plane, smoothness: Smoothness, motion: Plane | None = None
    ) -> None:
        shape = trimap.labels.shape
        require_shape(image, "image", (*shape, 3), "(h, w, 3) of the trimap's box")
        if motion is not None:
            require_shape(motion, "motion", shape, "(h, w) of the trimap's box")
        self.decided: Mask = trimap.labels == FOREGROUND
        self.part = bounds(trimap.band, 1)  # open pixels and their neighbours: others have no say
        labels = np.ascontiguousarray(trimap.labels[self.part])
        image = np.ascontiguousarray(image[self.part], np.float32)
        self.band: Mask = labels >= PROBABLE_BACKGROUND
        count = int(self.band.sum())
        node = np.full(labels.shape, -1, np.int32)
        node[self.band] = np.arange(count, dtype=np.int32)
        neighbor = np.full((count, 8), -1, np.int32)
        capacity = np.zeros((count, 8), np.int32)
        self.pull = np.zeros(count, np.int32)  # of decided neighbours
        calm = np.zeros((0, 0), np.float32)
        if motion is not None:
            motion = motion[self.part]
            calm = np.exp(-motion * motion)
        spread = _random_field_numba.mean_contrast(labels, image)
        if not np.isfinite(spread) or np.isnan(calm).any():
            raise InputError("image or motion holds what is no number; expected finite ones")
        temporal = 0.0 if motion is None else smoothness.temporal
        weights = (smoothness.contrast, temporal, 1 / (2 * max(spread, 1e-6)))
        _random_field_numba.connect(
            labels, image, calm, weights, _UNIT, node, neighbor, capacity, self.pull
        )
        self.cut = MinCut(neighbor, capacity)

    def solve(self, evidence: Plane) -> Mask:
        """Foreground (h, w) of least energy under nats in its favour (h, w)."""
        require_shape(evidence, "evidence", self.decided.shape, "(h, w) of the trimap's box")
        return self.settle(evidence[self.part][self.band])

    def settle(self, evidence: Plane) -> Mask:
        """The same under nats in favour of open pixels alone, (n,) in reading order."""
        require_shape(evidence, "evidence", self.pull.shape, "(n,), of each open pixel")
        nats = np.clip(evidence, -_MOST, _MOST).astype(np.float64)
        if np.isnan(nats).any():
            raise InputError("evidence holds what is no number; expected nats, finite or infinite")
        foreground = self.decided.copy()
        foreground[self.part][self.band] = self.cut.solve(
            self.pull + np.rint(nats * _UNIT).astype(np.int32)
        )
        return foreground
