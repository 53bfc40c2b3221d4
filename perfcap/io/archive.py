"""Archives of plain arrays (npz) that somebody else made: bounded, never pickles."""

from __future__ import annotations

import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, require_file

LIMIT = 2048 * MEBIBYTE  # of a file, and of what it unpacks to
SMALL = 192 * MEBIBYTE  # of arrays that a file of any size may hold
_PROPORTION = 3  # of arrays to their file beyond that
_NUMBER = 8  # bytes of a number once it is used
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
    """Those of the named arrays that an archive has.

    Headers are judged before anything is unpacked: the arrays, with numbers counted as the eight
    bytes that they will have, may take ``SMALL`` bytes, or more in proportion to the file.

    Args:
        path: the archive.
        names: of the arrays wanted.
        what: what the archive should be, for messages.

    Raises:
        InputError: it is missing, too large, damaged, or holds objects.
    """
    require_file(path, LIMIT, what)
    return _read(path, names, what)


def other_arrays(path: Path, names: Sequence[str], what: str) -> list[str]:
    """Names of the arrays of an archive but some, in its order.

    Raises:
        InputError: as ``read_archive``, of the archive itself.
    """
    require_file(path, LIMIT, what)
    with _reporting(path, what), zipfile.ZipFile(path) as archive:
        found = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
    return [name for name in found if name not in names]


def _read(path: Path, names: Sequence[str], what: str) -> dict[str, NDArray[Any]]:
    with _reporting(path, what), zipfile.ZipFile(path) as archive:
        members = {entry.filename: entry for entry in archive.infolist()}
        found = {name: members[f"{name}.npy"] for name in names if f"{name}.npy" in members}
        _require_modest(path, archive, found)
        return {name: _load(archive, entry) for name, entry in found.items()}


def _require_modest(
    path: Path, archive: zipfile.ZipFile, members: Mapping[str, zipfile.ZipInfo]
) -> None:
    """Refuse arrays that would be out of proportion to their file, by their headers alone."""
    size = path.stat().st_size
    allowed = min(LIMIT, SMALL + _PROPORTION * size)
    made = 0
    for name, entry in members.items():
        with archive.open(entry) as member:
            shape, _, dtype = _array_header(member)
        made += math.prod(shape) * max(dtype.itemsize, _NUMBER)
        if made > allowed:
            raise InputError(
                f"{path}: {name} is {dtype} {shape}; the file unpacks to {made / MEBIBYTE:.0f} MB "
                f"from {size / MEBIBYTE:.1f}, expected at most {allowed / MEBIBYTE:.0f}; split it"
            )


def _load(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """One array, with no byte read beyond those that its header asks for."""
    with archive.open(entry) as member:
        shape, column_major, dtype = _array_header(member)
        if dtype.hasobject:
            raise ValueError(f"{entry.filename} holds objects")
        size = math.prod(shape) * dtype.itemsize
        data = member.read(size)
        if len(data) != size or member.read(1):
            raise ValueError(f"{entry.filename} says {dtype} {shape}, which are {size} bytes")
    values = np.frombuffer(bytearray(data), dtype)  # of a copy that may be written to
    return values.reshape(shape, order="F" if column_major else "C")


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
    with _reporting(path, what), zipfile.ZipFile(path) as archive:
        members = {entry.filename: entry for entry in archive.infolist()}
    entry = members.get(f"{large}.npy")
    if entry is None or entry.compress_type != zipfile.ZIP_STORED:
        return read_archive(path, [large, *names], what)
    others = _read(path, names, what)
    with _reporting(path, what):
        return {large: _map(path, entry), **others}


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
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    version = np.lib.format.read_magic(file)
    if version not in readers:
        raise ValueError("an array in a format of its own")
    shape, column_major, dtype = readers[version](file, _HEADER_LIMIT)
    if min(shape, default=0) < 0:
        raise ValueError(f"an array of shape {shape}")
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
