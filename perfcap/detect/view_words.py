"""How sentences for the user call views: by their names where these are known."""

from __future__ import annotations

from collections.abc import Sequence


def view_words(views: Sequence[int], names: Sequence[str] | None) -> str:
    """``view left`` or ``views left and right``; of views without names, by number.

    Args:
        views: counted from 0.
        names: of all views.
    """
    which = [str(view) if names is None else names[view] for view in views]
    counted = ", counted from 0," if names is None else ""
    return f"view{'s' if len(views) > 1 else ''} {' and '.join(which)}{counted}"
