"""Whether arrays and tensors fit each other: compiled loops believe the shapes they are given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from perfcap.errors import InputError


def require_shape(array: Any, name: str, wanted: Sequence[int | None], what: str) -> None:
    """Refuse an array or a tensor of another shape.

    Args:
        array: with a ``shape``.
        name: what the message calls it.
        wanted: sizes, None where any will do.
        what: the shape in letters, and what it is of.

    Raises:
        InputError: it is of another shape.
    """
    own = tuple(array.shape)
    fits = len(own) == len(wanted) and all(
        size is None or side == size for side, size in zip(own, wanted, strict=True)
    )
    if not fits:
        numbers = ", ".join("any" if size is None else str(size) for size in wanted)
        raise InputError(f"{name} has shape {own}, expected ({numbers}): {what}")


def require_indices(indices: Any, name: str, count: int, what: str, least: int = 0) -> None:
    """Refuse whole numbers, in an array or a tensor, that are not from ``least`` to below a count.

    Args:
        indices: of any shape.
        name: what the message calls them.
        count: how many there are of what they name.
        what: they name.
        least: the lowest one, as where -1 says that there is none.

    Raises:
        InputError: one is beyond.
    """
    if 0 in indices.shape:
        return
    low, high = int(indices.min()), int(indices.max())
    if low < least or high >= count:
        raise InputError(
            f"{name} names {what} {low} to {high} but there are {count}; expected {least} to "
            f"{count - 1}"
        )


def require_picture(image: Any, name: str, size: Sequence[int] | None = None) -> None:
    """Refuse what is no RGB image in bytes: of shares from 0 to 1, all were one dark colour.

    Args:
        image: NumPy array that should be (H, W, 3) uint8.
        name: what the message calls it.
        size: its (H, W); None where any will do.

    Raises:
        InputError: it is of another kind or size.
    """
    shape, dtype = tuple(getattr(image, "shape", ())), getattr(image, "dtype", None)
    if len(shape) != 3 or shape[2] != 3 or 0 in shape or str(dtype) != "uint8":
        given = type(image).__name__ if dtype is None else f"{dtype} {shape}"
        raise InputError(
            f"{name} is {given}, expected uint8 (H, W, 3) RGB from 0 to 255, as NumPy array: "
            "multiply shares of 0 to 1 by 255"
        )
    if size is not None and shape[:2] != tuple(size):
        raise InputError(f"{name} has {shape[:2]} rows and columns, expected {tuple(size)}")


def require_mask(mask: Any, name: str, size: Sequence[int]) -> None:
    """Refuse what is no mask of bool, one for each pixel of an image.

    Args:
        mask: NumPy array that should be bool, (H, W).
        name: what the message calls it.
        size: (H, W) of the image.

    Raises:
        InputError: it is of another type or size.
    """
    shape, dtype = tuple(getattr(mask, "shape", ())), getattr(mask, "dtype", None)
    if shape != tuple(size) or str(dtype) != "bool":
        given = type(mask).__name__ if dtype is None else f"{dtype} {shape}"
        raise InputError(
            f"{name} is {given}, expected bool {tuple(size)}, as the image is: compare bytes, as "
            "mask > 127, and soft masks, as mask > 0.5"
        )
