"""Archives of plain arrays (npz) that somebody else made: bounded, never pickles."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, require_file

LIMIT = 2048 * MEBIBYTE  # unpacked

# what the standard library and numpy raise on archives that are cut, damaged or made up
_UNREADABLE = (
    *(OSError, ValueError, EOFError, MemoryError, NotImplementedError, RuntimeError),
    *(zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error),
)


def read_archive(path: Path, names: Sequence[str], what: str) -> dict[str, NDArray[Any]]:
    """Those of the named arrays that an archive has, checked for size before it is unpacked.

    Args:
        path: the archive.
        names: of the arrays wanted.
        what: what the archive should be, for messages.

    Raises:
        InputError: it is missing, too large, damaged, or holds objects.
    """
    require_file(path, LIMIT, what)
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > LIMIT:
            raise InputError(
                f"{path}: unpacks to {unpacked / MEBIBYTE:.0f} MB, expected at most "
                f"{LIMIT / MEBIBYTE:.0f} MB; split the clip"
            )
        with np.load(path, allow_pickle=False) as data:
            return {name: data[name] for name in names if name in data.files}
    except InputError:
        raise
    except _UNREADABLE as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"{path}: is not a readable npz archive of plain arrays ({reason}); expected {what}; "
            "write it again with numpy.savez"
        ) from error
