"""Whether numbers of a configuration can be what they are called, by name."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import Any

from perfcap.errors import InputError


def require_counts(settings: Any, *names: str, least: int = 1) -> None:
    """Refuse fields that are no whole numbers of ``least`` or more.

    Raises:
        InputError: one is none.
    """
    for name in names:
        count = getattr(settings, name)
        if not isinstance(count, Integral) or isinstance(count, bool) or count < least:
            raise InputError(f"{name} is {count!r}, expected a whole number of {least} or more")


def require_sizes(settings: Any, *names: str) -> None:
    """Refuse fields that are no numbers above zero: residuals are divided by them.

    Raises:
        InputError: one is none.
    """
    for name in names:
        size = getattr(settings, name)
        if not _number(size) or not size > 0:
            raise InputError(f"{_named(settings, name)} is {size!r}, expected a number above zero")


def require_shares(settings: Any, *names: str, most: float = 1.0) -> None:
    """Refuse fields that are not from 0 to ``most``.

    Raises:
        InputError: one is not.
    """
    for name in names:
        share = getattr(settings, name)
        if not _number(share) or not 0 <= share <= most:
            limit = "zero or above" if math.isinf(most) else f"from 0 to {most:g}"
            raise InputError(f"{_named(settings, name)} is {share!r}, expected a number {limit}")


def require_parts(settings: Any, **kinds: type) -> None:
    """Refuse fields that are of another kind.

    Raises:
        InputError: one is.
    """
    for name, kind in kinds.items():
        part = getattr(settings, name)
        if not isinstance(part, kind):
            raise InputError(f"{name} is a {type(part).__name__}, expected a {kind.__name__}")


def _number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _named(settings: Any, name: str) -> str:
    return f"{name} of {type(settings).__name__}"
