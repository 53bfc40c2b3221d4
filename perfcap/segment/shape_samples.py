"""The shape prior from samples of everybody's poses (Liu et al. 2013, Sec. 5.2, Eq. 18 to 23).

How often a pixel shows a person among the samples is how probable that person is there. The closed
form of ``label_people`` counts as one more sample, so that pixels that no sample covers, as those
of a skirt that swings, are the nearest person's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.array_checks import require_indices, require_shape
from perfcap.errors import InputError
from perfcap.render.label_map import BITS, Cull, snap
from perfcap.segment import _shape_samples_numba
from perfcap.segment.trimap import Box, Mask
from perfcap.setting_checks import Settings, require_counts, require_shares

Plane = NDArray[np.float32]
Labels = NDArray[np.int16]
Floats = NDArray[np.float64]

_STEPS = 40  # halvings of the temperature's logarithm


@dataclass(frozen=True)
class ShapeSamples(Settings):
    """How poses are drawn and what they count (LIU-14, LIU-15).

    Attributes:
        center: of the poses that are drawn: the previous frame's, as in the paper, or the frame's
            own with the covariance of the solve, where that is known.
        count: samples (n).
        spread: deviations about the previous pose: place, m, rotation and angles, rad. The paper
            gives no numbers.
        effective: least effective share of the samples once they are weighed by how well they fit
            the foreground; 0 is the paper's weights, with 1 all count alike.
        culled: whether a second projection without front faces shows who is inside another person.
        cell: m, of the coarse mesh that is drawn; 0 draws all of it.
        seed: of the random numbers.
    """

    center: Literal["previous", "solved"] = "solved"
    count: int = 300
    spread: tuple[float, float, float] = (0.03, 0.1, 0.15)
    effective: float = 1.0
    culled: bool = True
    cell: float = 0.03
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_counts(self, "count")
        require_shares(self, "effective")


@dataclass(frozen=True, eq=False)
class SampledPeople:
    """Everybody in N poses in one frame and view.

    Attributes:
        pixels: vertices of everybody's meshes in a row, (N, V, 2) px of the image.
        depth: (N, V) m.
        faces: triangles of these, (T, 3).
        labels: the person's number times P plus the part, of each triangle, (T,).
        shares: of the person's surface that each part is, (K, P).
        blur: deviation of outlines that poses do not explain, px.
        settings: how samples count.
    """

    pixels: Tensor
    depth: Tensor
    faces: Tensor
    labels: Labels
    shares: Floats
    blur: float
    settings: ShapeSamples

    def __post_init__(self) -> None:
        if self.pixels.shape != (*self.depth.shape, 2) or self.depth.ndim != 2:
            raise InputError(
                f"pixels has shape {tuple(self.pixels.shape)} and depth "
                f"{tuple(self.depth.shape)}; expected (N, V, 2) and (N, V)"
            )
        if len(self.labels) != len(self.faces):
            raise InputError(
                f"labels has {len(self.labels)} entries but faces {len(self.faces)}; give one for "
                "each triangle"
            )
        require_shape(self.faces, "faces", (None, 3), "(T, 3)")
        require_indices(self.faces, "faces", self.depth.shape[1], "vertices")
        count = self.shares.size
        require_indices(self.labels, "labels", count, "parts of people")

    def prior(self, box: Box, foreground: Mask, closed: Plane) -> Plane:
        """Probability that a pixel of anybody is one of each person, (K, h, w), of sum one.

        Args:
            box: rows and columns of the image.
            foreground: where somebody is, (h, w).
            closed: the prior in closed form, (K, h, w).
        """
        require_shape(closed[0], "closed", foreground.shape, "(h, w) of the foreground, of each")
        shown = self.shown(box)
        weights = self._weights(shown, foreground)
        people = np.where(shown >= 0, shown // self.shares.shape[1], -1)
        count = len(shown)
        found = np.empty(closed.shape, np.float32)
        for number in range(len(closed)):
            there = np.einsum("n,nhw->hw", weights, people == number)
            plane = there.astype(np.float32)
            if self.blur > 0:
                plane = cv2.GaussianBlur(plane, (0, 0), self.blur, borderType=cv2.BORDER_REPLICATE)
            found[number] = count * plane + closed[number]
        prior: Plane = found / found.sum(0)
        return prior

    def shown(self, box: Box) -> Labels:
        """Label of whom and which part each sample shows, (N, h, w); -1 where nobody is."""
        grid, inverse, usable = snap(self.pixels, self.depth)
        corner = torch.tensor([box[1].start, box[0].start])
        grid = grid - (corner << BITS)
        shape = [side.stop - side.start for side in box]
        shown = np.empty((len(grid), *shape), np.int16)
        front = Cull.FRONT.value if self.settings.culled else Cull.NONE.value
        arrays = [each.numpy() for each in (grid, inverse, usable, self.faces)]
        parts = self.shares.shape[1]
        _shape_samples_numba.show(*arrays, self.labels, parts, front, BITS, shown)
        return shown

    def _weights(self, shown: Labels, foreground: Mask) -> Floats:
        """Of the samples (N,), of sum one (Eq. 19 to 21), in this part of the image alone."""
        count = len(shown)
        if self.settings.effective >= 1:
            return np.full(count, 1 / count)
        missed = (shown < 0) & foreground
        spilled = np.append(self.shares.ravel(), 0.0)[shown] * ~foreground
        cost = missed.sum((1, 2)) + spilled.sum((1, 2))
        return tempered(cost - cost.min(), self.settings.effective)


def tempered(nats: Floats, effective: float) -> Floats:
    """Weights ``exp(-nats)``, flattened as little as leaves an effective share of the samples.

    The effective number of samples of weights w of sum one is ``1 / sum w^2``.

    Args:
        nats: of each sample, (N,), the least of them 0.
        effective: share of the samples, 0 to 1.

    Example:
        >>> tempered(np.array([0.0, 0.0, 1e4, 1e4]), 0.5).round(3)
        array([0.5, 0.5, 0. , 0. ])
    """

    def weights(temperature: float) -> Floats:
        found: Floats = np.exp(-nats / temperature)
        whole: Floats = found / found.sum()
        return whole

    def enough(found: Floats) -> bool:
        return bool(1 / np.square(found).sum() >= effective * len(nats))

    if enough(weights(1.0)):
        return weights(1.0)
    low, high = 0.0, float(np.log(1e3 * max(nats.max(), 1.0) * len(nats)))
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if enough(weights(np.exp(middle))) else (middle, high)
    found: Floats = weights(float(np.exp(high)))
    return found
