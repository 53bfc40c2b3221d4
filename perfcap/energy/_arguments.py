"""Arguments that most energies have: units, and points that move."""

from __future__ import annotations

import math
from collections.abc import Collection

from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.plain import is_plain


def require_unit(unit: float | Tensor, name: str = "unit") -> None:
    """Refuse what residuals cannot be divided by; a tensor elsewhere may hide its numbers.

    Raises:
        InputError: it is zero, negative or NaN. What is infinite counts for nothing.
    """
    _require(unit, name, "a number above zero, by which residuals are divided", above=True)


def require_scale(scale: float | Tensor, name: str) -> None:
    """Refuse factors of residuals that are negative, infinite or NaN, likewise.

    Raises:
        InputError: one is.
    """
    _require(scale, name, "a finite number from 0 on", above=False)


def _require(given: float | Tensor, name: str, wanted: str, *, above: bool) -> None:
    if isinstance(given, Tensor):
        given = given.detach()
        if not is_plain(given):
            return
        sound = bool((given > 0 if above else (given >= 0) & (given < math.inf)).all())
        given = float(given.min())
    else:
        sound = given > 0 if above else 0 <= given < math.inf
    if not sound:
        raise InputError(f"{name} is {given}; expected {wanted}")


def seen_by(points: object) -> Collection[str]:
    """Shared unknowns that points depend on, by name.

    Raises:
        InputError: they are no points, but an actor, say.
    """
    sees: Collection[str] | None = getattr(points, "sees", None)
    if sees is None:
        raise InputError(
            f"points: got a {type(points).__name__}, expected points that move with a motion, such "
            "as actor.landmarks"
        )
    return sees
