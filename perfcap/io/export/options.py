"""What can be chosen about an export, and what formats do with it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

UNITS: Mapping[str, float] = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
"""Units of length, and how many of them a metre has."""


@dataclass(frozen=True)
class Options:
    """Choices beyond the format.

    Attributes:
        unit: of length, where the format leaves it open: a key of ``UNITS``.
        surface: whether the captured surface goes along where there is one.
        markers: whether markers are the 16 ``landmarks`` or the origins of all ``bones``.
        order: of Euler angles, such as ``ZXY``; ``auto`` takes for each joint the one whose angles
            move the least between frames.
    """

    unit: str = "m"
    surface: bool = True
    markers: str = "landmarks"
    order: str = "auto"

    @property
    def per_metre(self) -> float:
        """Units in a metre."""
        return UNITS[self.unit]


# --- Names as formats allow them ------------------------------------------------------------------


def unique_names(names: Sequence[str], clean: Callable[[str], str]) -> tuple[str, ...]:
    """Cleaned names; those that became equal are numbered."""
    found: dict[str, None] = {}
    for name in names:
        plain = clean(name)
        candidate, number = plain, 1
        while candidate in found:
            number += 1
            candidate = f"{plain}_{number}"
        found[candidate] = None
    return tuple(found)


def word(name: str) -> str:
    """A name without blanks, braces and control characters, for formats that split at blanks."""
    return re.sub(r"[\s{}\x00-\x1f\x7f]+", "_", name).strip("_") or "unnamed"


def identifier(name: str) -> str:
    """A name of ASCII letters, digits and underscores that starts with none of the digits."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name) or "unnamed"
    return f"_{plain}" if plain[0].isdigit() else plain


def ascii_label(name: str) -> str:
    """A name of printable ASCII, for formats whose strings are bytes."""
    return re.sub(r"[^\x21-\x7e]", "_", name) or "unnamed"
