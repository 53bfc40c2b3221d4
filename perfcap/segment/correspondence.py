"""Which image contour point belongs to which point of the model's contour?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Correspondences:
    """Pairs of a model point and a line of the image, padded to the longest frame and view.

    A pair says that the model point ``sum_k weights_k * vertices_k`` shall project onto the line
    through ``target`` with normal ``normal`` (Xu 2018, Eq. 11 and 17). Padding has confidence 0,
    vertices 0, weights (1, 0), target 0 and normal 0: it is safe to evaluate and counts nothing.

    Attributes:
        vertices: (*b, F, C, P, 2) int64, the two vertices of the mesh a model point lies between.
        weights: (*b, F, C, P, 2), their shares, rows sum to one.
        target: (*b, F, C, P, 2) px.
        normal: (*b, F, C, P, 2), unit, outward normal of the image contour.
        confidence: (*b, F, C, P), 0 to 1.
    """

    vertices: Tensor
    weights: Tensor
    target: Tensor
    normal: Tensor
    confidence: Tensor

    def __post_init__(self) -> None:
        shape = tuple(self.confidence.shape)
        if len(shape) < 3:
            raise InputError(f"confidence has shape {shape}; expected (*b, F, C, P)")
        for name in ("vertices", "weights", "target", "normal"):
            found = tuple(getattr(self, name).shape)
            if found != (*shape, 2):
                raise InputError(f"{name} has shape {found}; expected {(*shape, 2)}")
        if self.vertices.dtype != torch.int64:
            raise InputError(f"vertices is {self.vertices.dtype}; expected torch.int64")

    @property
    def frame_count(self) -> int:
        """F."""
        return self.confidence.shape[-3]

    @property
    def views(self) -> int:
        """C."""
        return self.confidence.shape[-2]

    def frames(self, index: slice | Tensor) -> Self:
        """The pairs of some frames."""
        parts = {
            field.name: getattr(self, field.name)[..., index, :, :, :]
            for field in fields(self)
            if field.name != "confidence"
        }
        return replace(self, **parts, confidence=self.confidence[..., index, :, :])

    def apart(self) -> Self:
        """The same pairs with every frame a batch element of its own, (*b, F, 1, C, P)."""
        parts = {
            field.name: getattr(self, field.name).unsqueeze(-4)
            for field in fields(self)
            if field.name != "confidence"
        }
        return replace(self, **parts, confidence=self.confidence.unsqueeze(-3))

    def to(self, like: Tensor) -> Self:
        """The same pairs with the type and device of a tensor; ``vertices`` stays int64."""
        return replace(
            self,
            vertices=self.vertices.to(like.device),
            weights=self.weights.to(like),
            target=self.target.to(like),
            normal=self.normal.to(like),
            confidence=self.confidence.to(like),
        )


@dataclass(frozen=True)
class Matches:
    """Pairs of one frame and view, numpy; see ``Correspondences``.

    Attributes:
        vertices: (P, 2) int64.
        weights: (P, 2).
        target: (P, 2) px.
        normal: (P, 2).
        confidence: (P,), above 0.
        model: (P,) int64, index of the pair's point in the model contour.
        image: (P,) int64, index of the pair's point in the image contour, -1 for a point of the
            model that is held where it is.
    """

    vertices: Integers
    weights: Floats
    target: Floats
    normal: Floats
    confidence: Floats
    model: Integers
    image: Integers

    def __len__(self) -> int:
        return len(self.confidence)


def stack(matches: Sequence[Sequence[Matches]], like: Tensor) -> Correspondences:
    """Pad matches to one tensor.

    Args:
        matches: of each frame and view, ``[F][C]``; any of them may be empty.
        like: a floating-point tensor whose type and device the result has.

    Returns:
        Correspondences (F, C, P), P being the most pairs of any frame and view and at least 1.

    Raises:
        InputError: frames differ in their number of views, or ``like`` holds whole numbers.
    """
    if not like.is_floating_point():
        raise InputError(
            f"like is {like.dtype}, in which weights and normals are whole numbers; expected a "
            "floating-point tensor"
        )
    frames, views = len(matches), len(matches[0]) if matches else 0
    if any(len(row) != views for row in matches):
        found = sorted({len(row) for row in matches})
        raise InputError(f"matches has frames of {found} views; expected the same views everywhere")
    longest = max([1, *(len(each) for row in matches for each in row)])
    shape = (frames, views, longest)
    vertices = np.zeros((*shape, 2), np.int64)
    weights = np.zeros((*shape, 2))
    weights[..., 0] = 1.0
    target, normal = np.zeros((*shape, 2)), np.zeros((*shape, 2))
    confidence = np.zeros(shape)
    for frame, row in enumerate(matches):
        for view, each in enumerate(row):
            here = (frame, view, slice(len(each)))
            vertices[here], weights[here] = each.vertices, each.weights
            target[here], normal[here] = each.target, each.normal
            confidence[here] = each.confidence
    arrays = (vertices, weights, target, normal, confidence)
    return Correspondences(*(torch.from_numpy(array) for array in arrays)).to(like)
