"""The random field of several labels (Liu et al. 2013, Sec. 5.1, Eq. 12 to 14).

Energy of a labelling: the nats of each pixel's label, and for each pair of the eight neighbours
with different labels

    (contrast exp(-|c_i - c_j|^2 / 2 mean) + potts) / |i - j|.

It is minimised by alpha-expansion (Boykov, Veksler and Zabih 2001): pixels may change to one label,
all together, which is a least cut; labels take turns until none lowers the energy. Of two labels
the first turn is the least energy of all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_indices, require_shape
from perfcap.errors import InputError
from perfcap.segment import _label_field_numba
from perfcap.segment.min_cut import solve_min_cut
from perfcap.setting_checks import Settings

Plane = NDArray[np.float32]
Labels = NDArray[np.uint8]
Mask = NDArray[np.bool_]

_UNIT = 256.0  # integer price of a nat
_MOST = 200.0  # nats; keeps capacities and their sums within 32 bits
_FORBIDDEN = round(_MOST * _UNIT)
_TURNS = 5  # of all labels, at most


@dataclass(frozen=True)
class FieldSettings(Settings):
    """Prices of neighbours with different labels.

    Attributes:
        contrast: nats of neighbours of equal colour.
        potts: nats, whatever their colours.
    """

    contrast: float = 3.0
    potts: float = 0.1


@dataclass(frozen=True)
class LabelField:
    """An energy of labels.

    Attributes:
        open: pixels whose label is sought, (h, w).
        price: of each of L labels at each pixel, (L, h, w), 256 a nat.
        links: of different labels of a pixel and its next four neighbours, (h, w, 4).
    """

    open: Mask
    price: NDArray[np.int32]
    links: NDArray[np.int32]

    def __post_init__(self) -> None:
        shape = self.open.shape
        require_shape(self.price, "price", (None, *shape), "(L, h, w) of the open pixels")
        _require_labels(self.price)
        require_shape(self.links, "links", (*shape, 4), "(h, w, 4) of the open pixels")

    @classmethod
    def of(
        cls, image: Plane, nats: Plane, open_: Mask, settings: FieldSettings | None = None
    ) -> LabelField:
        """The energy of an image.

        Args:
            image: colours (h, w, 3), grey levels.
            nats: what speaks against each label, (L, h, w); 200 and more forbid it.
            open_: pixels whose label is sought, (h, w).
            settings: prices of neighbours.

        Raises:
            InputError: arrays of other shapes, or what is no number.
        """
        settings = settings or FieldSettings()
        if nats.ndim != 3 or nats.shape[1:] != open_.shape or image.shape != (*open_.shape, 3):
            raise InputError(
                f"label field: nats {nats.shape}, image {image.shape} and open pixels "
                f"{open_.shape}; expected (L, h, w), (h, w, 3) and (h, w)"
            )
        _require_labels(nats)
        if np.isnan(nats).any():
            raise InputError("label field: nats are not numbers; expected finite or infinite ones")
        colors = np.ascontiguousarray(image, np.float32)
        chosen = np.ascontiguousarray(open_)
        # what a pixel's labels have in common is no choice
        least = nats.min(0)
        above = np.minimum(nats - np.where(np.isfinite(least), least, 0), _MOST)
        links = np.zeros((*open_.shape, 4), np.int32)
        spread = _label_field_numba.mean_contrast(chosen, colors)
        if not np.isfinite(spread):
            raise InputError("label field: the image holds what is no number; expected finite ones")
        weights = settings.contrast, settings.potts, 1 / (2 * max(spread, 1e-6))
        _label_field_numba.link(chosen, colors, weights, _UNIT, links)
        price = np.ascontiguousarray(np.rint(above * _UNIT), np.int32)
        return cls(chosen, price, links)

    def energy(self, labels: Labels) -> float:
        """Nats of a labelling (h, w)."""
        self._require_labels(labels)
        return float(_label_field_numba.energy(labels, self.price, self.links)) / _UNIT

    def solve(self, start: Labels) -> Labels:
        """A labelling (h, w) that no change to any one label improves.

        Args:
            start: labels to begin with; those of pixels that are not open stay.
        """
        self._require_labels(start)
        labels = np.array(start, np.uint8, order="C")
        best = _label_field_numba.energy(labels, self.price, self.links)
        idle, label = 0, 0
        for turn in range(_TURNS * len(self.price)):
            label = turn % len(self.price)
            found = self._expanded(labels, label)
            cost = _label_field_numba.energy(found, self.price, self.links)
            idle = 0 if cost < best else idle + 1
            if cost < best:
                labels, best = found, cost
            if idle >= len(self.price):
                break
        return labels

    def _require_labels(self, labels: Labels) -> None:
        require_shape(labels, "labels", self.open.shape, "(h, w) of the field")
        require_indices(labels, "labels", len(self.price), "label")

    def _expanded(self, labels: Labels, label: int) -> Labels:
        free = self.open & (labels != label) & (self.price[label] < _FORBIDDEN)
        count = int(free.sum())
        if not count:
            return labels
        node = np.full(labels.shape, -1, np.int32)
        node[free] = np.arange(count, dtype=np.int32)
        neighbor = np.full((count, 8), -1, np.int32)
        capacity = np.zeros((count, 8), np.int32)
        excess = np.zeros(count, np.int32)
        _label_field_numba.expand(
            *(labels, self.price, self.links, label, node, neighbor, capacity, excess)
        )
        changes, _ = solve_min_cut(neighbor, capacity, excess)
        found = labels.copy()
        found[free] = np.where(changes, np.uint8(label), labels[free])
        return found


def _require_labels(given: NDArray[np.generic]) -> None:
    """Refuse a field without labels, of which no pixel has one."""
    if not len(given):
        raise InputError("label field: there are no labels; expected (L, h, w) of one or more")
