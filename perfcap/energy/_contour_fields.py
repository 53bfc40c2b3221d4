"""What an image has to say of contours: three numbers a pixel, whatever made them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.array_checks import require_shape

_FLOATS = torch.float32, torch.float64
_KINDS = np.float32, np.float64  # that kernels are compiled for


class Field(Protocol):
    """What contours gain and pay in a part of an image; ``EdgeField`` is one.

    Arrays of type float32, or tensors.
    """

    @property
    def edges(self) -> Any:
        """Cosine and sine of twice the direction of edges, times their strength, (2, h, w)."""

    @property
    def flat(self) -> Any:
        """Price of a unit of contour, (h, w)."""

    @property
    def corner(self) -> tuple[int, int]:
        """Row and column of the first pixel in the image."""


class FlatField:
    """A field in which a unit of contour costs one."""

    def __init__(self, like: Field) -> None:
        self.edges = np.zeros(tuple(like.edges.shape), np.float32)
        self.flat = np.ones(tuple(like.flat.shape), np.float32)
        self.corner = like.corner


class FreeField:
    """A field in which no contour has a price."""

    def __init__(self, like: Field) -> None:
        self.edges = numbers(like.edges).astype(np.float32)
        self.flat = np.zeros(tuple(like.flat.shape), np.float32)
        self.corner = like.corner


def numbers(part: Any) -> NDArray[Any]:
    """A part of a field as an array, side by side in memory."""
    if isinstance(part, Tensor):
        part = (part if part.dtype in _FLOATS else part.float()).numpy(force=True)
    plain = np.asarray(part)
    return np.ascontiguousarray(plain, plain.dtype if plain.dtype in _KINDS else np.float32)


def require_images(fields: Sequence[Sequence[Field]]) -> None:
    """Refuse fields whose edges are not of the pixels that have prices.

    Raises:
        InputError: one is such.
    """
    for field in (each for row in fields for each in row):
        require_shape(field.flat, "flat of a field", (None, None), "(h, w)")
        require_shape(field.edges, "edges of a field", (2, *field.flat.shape), "(2, h, w) of flat")


def strength(field: Field) -> NDArray[Any]:
    """Of the edges of a field, (h, w)."""
    found: NDArray[Any] = np.hypot(*numbers(field.edges))
    return found


def recorded(field: Field) -> bool:
    """Whether gradients of the field are wanted."""
    return any(
        isinstance(each, Tensor) and each.requires_grad for each in (field.edges, field.flat)
    )


def whole(field: Field, like: Tensor) -> Tensor:
    """Edges and price in one, (3, h, w), on the device of a tensor; tensors keep their graph."""
    edges, flat = (torch.as_tensor(part).to(like) for part in (field.edges, field.flat))
    return torch.cat((edges, flat[None]))
