"""Names as formats allow them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence


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
