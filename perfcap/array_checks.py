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
