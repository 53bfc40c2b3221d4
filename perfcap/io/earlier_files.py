"""What stays in the folder of a result that is replaced, and may have been made of it."""

from __future__ import annotations

import logging
import os
from collections.abc import Collection
from pathlib import Path

_NAMED = 5  # files of which a sentence gives the names

_LOG = logging.getLogger(__name__)


def tell_of_exports(place: Path) -> None:
    """Say that a folder holds files for other programs, which are left where they are."""
    if place.is_symlink() or not place.is_dir():
        return
    if os.access(place, os.R_OK) and os.listdir(place):
        told = "holds files of the result that was replaced; perfcap export writes this one's"
        _LOG.warning("%s: %s", place, told)


def tell_of_others(folder: Path, own: Collection[str], since: int) -> None:
    """Say what else was written into the folder after the result that was replaced.

    Args:
        folder: of the new result.
        own: names in it that are the result's own.
        since: when the older result was written, in nanoseconds.
    """
    others = (path for path in sorted(folder.iterdir()) if path.name not in own)
    names = [p.name for p in others if not p.name.startswith(".") and written_at(p) > since]
    if not names:
        return
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    _LOG.warning(
        "%s: keeps %s%s from before; what was made of the result that was replaced has to be made "
        "anew",
        folder,
        ", ".join(names[:_NAMED]),
        more,
    )


def written_at(path: Path) -> int:
    """When something was last written, in nanoseconds; 0 where it is missing."""
    try:
        return path.lstat().st_mtime_ns
    except OSError:
        return 0
