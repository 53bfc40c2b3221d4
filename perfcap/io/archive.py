"""Archives of plain arrays (npz) that somebody else made: bounded, never pickles."""

from __future__ import annotations

import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, require_file

LIMIT = 2048 * MEBIBYTE  # unpacked
_HEADER_LIMIT = 4096  # bytes of an array's header
_MEMBER_HEADER = 30  # bytes before a member's name and extra field

# what the standard library and numpy raise on archives that are cut, damaged or made up
_UNREADABLE = (
    *(OSError, ValueError, EOFError, MemoryError, NotImplementedError, RuntimeError),
    *(zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error),
    # from numpy's parser of array headers
    *(SyntaxError, tokenize.TokenError, TypeError, LookupError, struct.error),
)


def read_archive(path: Path, names: Sequence[str], what: str) -> dict[str, NDArray[Any]]:
    """Those of the named arrays that an archive has, checked for size before they are unpacked.

    Args:
        path: the archive.
        names: of the arrays wanted.
        what: what the archive should be, for messages.

    Raises:
        InputError: it is missing, too large, damaged, or holds objects.
    """
    require_file(path, LIMIT, what)
    with _reporting(path, what):
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > LIMIT:
            raise InputError(
                f"{path}: unpacks to {unpacked / MEBIBYTE:.0f} MB, expected at most "
                f"{LIMIT / MEBIBYTE:.0f} MB; split the clip"
            )
        return _load(path, names)


def map_archive(
    path: Path, large: str, names: Sequence[str], what: str, limit: int
) -> dict[str, NDArray[Any]]:
    """Like ``read_archive``, with one array left in the file and mapped into memory, read-only.

    It can be mapped when it is stored without compression; otherwise it is loaded like the others.

    Args:
        path: the archive.
        large: name of the array to map.
        names: of the other arrays wanted.
        what: what the archive should be, for messages.
        limit: of the file, bytes.

    Raises:
        InputError: as ``read_archive``; the limits there hold for everything that is not mapped.
    """
    require_file(path, limit, what)
    with _reporting(path, what):
        with zipfile.ZipFile(path) as archive:
            members = {entry.filename: entry for entry in archive.infolist()}
        entry = members.pop(f"{large}.npy", None)
        if entry is None or entry.compress_type != zipfile.ZIP_STORED:
            return read_archive(path, [large, *names], what)
        if sum(member.file_size for member in members.values()) > LIMIT:
            raise InputError(f"{path}: unpacks to more than expected of {what}; write it again")
        return {large: _map(path, entry), **_load(path, names)}


def _load(path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    with np.load(path, allow_pickle=False) as data:
        return {name: data[name] for name in names if name in data.files}


def _map(path: Path, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """The array of a member that is stored as it is, where it lies in the file."""
    with path.open("rb") as file:
        file.seek(entry.header_offset)
        header = file.read(_MEMBER_HEADER)
        # the name and the extra field in front of the data may differ from the central directory's
        name, extra = (int.from_bytes(header[at : at + 2], "little") for at in (26, 28))
        begin = entry.header_offset + _MEMBER_HEADER + name + extra
        file.seek(begin)
        shape, column_major, dtype = _array_header(file)
        start = file.tell()
        available = file.seek(0, 2) - start
    size = math.prod(shape) * dtype.itemsize
    if dtype.hasobject or not 0 < size == entry.file_size - (start - begin) <= available:
        raise ValueError(f"{entry.filename} says {dtype} {shape} in {entry.file_size} bytes")
    return np.memmap(path, dtype, "r", start, shape, "F" if column_major else "C")


def _array_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    if np.lib.format.read_magic(file) != (1, 0):
        raise ValueError("an array in a format of its own")
    shape, column_major, dtype = np.lib.format.read_array_header_1_0(file, _HEADER_LIMIT)
    return shape, column_major, dtype


@contextmanager
def _reporting(path: Path, what: str) -> Iterator[None]:
    """Whatever a damaged archive makes the libraries raise, as one line."""
    try:
        yield
    except InputError:
        raise
    except _UNREADABLE as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"{path}: is not a readable npz archive of plain arrays ({reason}); expected {what}; "
            "write it again with numpy.savez"
        ) from error
