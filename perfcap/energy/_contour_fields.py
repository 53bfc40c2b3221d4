"""What an image has to say of contours: three numbers a pixel, whatever made them."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor


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
    plain = part.numpy(force=True) if isinstance(part, Tensor) else np.asarray(part)
    return np.ascontiguousarray(plain)


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
