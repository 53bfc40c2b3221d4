"""Arrays of MATLAB files: version 5 to 7, and 7.3 (HDF5) with h5py, if it is there."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, require_file

# --------------------------------------------------------------------------------------------------
# Numbers and cells of MATLAB files of version 5 to 7, read without trusting a length in them.
#
# scipy's reader of such files can be made to read memory that is none of the file's, and crash.
# The layout is MathWorks' "MAT-File Format", chapter 1, level 5.

HEADER = 128  # bytes: a text, a version, and the order of bytes
_VERSION = 0x0100
_MATRIX, _COMPRESSED = 14, 15
_CELL = 1
_COMPLEX = 0x08
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8"}
_STORED |= {13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8"}
_CLASSES |= {15: "u8"}
_DEEPEST = 4  # cells in cells
_MOST = 1 << 28  # bytes that are unpacked for one variable, and numbers that are made
_AHEAD = 1 << 12  # bytes that are unpacked to see a variable's name


@dataclass(frozen=True)
class _Element:
    """One element: its kind, what is in it, and where the next one starts."""

    kind: int
    data: memoryview
    end: int


def read_variables(data: bytes, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Those of the named variables that are numbers or cells; cells are arrays of objects.

    Raises:
        ValueError: the bytes are no such file, or it is damaged.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:HEADER], "")
    if not order or struct.unpack_from(f"{order}H", data, 124)[0] != _VERSION:
        raise ValueError("its header is not that of version 5 to 7")
    found: dict[str, NDArray[Any]] = {}
    for element in _elements(memoryview(data)[HEADER:], order, padded=False):
        variable = _unpacked(element, order, names)
        if variable is None:
            continue
        matrix = _Matrix.of(variable, order)
        if matrix.name in names:
            found[matrix.name] = matrix.values()
    return found


def _unpacked(element: _Element, order: str, names: Sequence[str]) -> memoryview | None:
    """The matrix in an element; None where it is none, or one that nobody asked for."""
    if element.kind == _MATRIX:
        return element.data
    if element.kind != _COMPRESSED:
        return None
    try:
        start = zlib.decompressobj().decompress(element.data[:_AHEAD], _AHEAD)
        if not any(name.encode() in start for name in names):
            return None
        unpacking = zlib.decompressobj()
        whole = unpacking.decompress(element.data, _MOST)
    except zlib.error as error:
        raise ValueError(f"a variable cannot be unpacked: {error}") from error
    if unpacking.unconsumed_tail:
        raise ValueError(f"a variable is larger than {_MOST} bytes")
    inner = _element(memoryview(whole), 0, order, padded=True)
    return inner.data if inner.kind == _MATRIX else None


def _elements(data: memoryview, order: str, *, padded: bool) -> Iterator[_Element]:
    at = 0
    while at < len(data):
        element = _element(data, at, order, padded=padded)
        yield element
        at = element.end


def _element(data: memoryview, at: int, order: str, *, padded: bool) -> _Element:
    """The element at a place; short ones keep up to four bytes beside their kind."""
    if len(data) - at < 8:
        raise ValueError("it ends in the middle of an element")
    kind, size = struct.unpack_from(f"{order}II", data, at)
    first = at + 8
    if kind >> 16:
        kind, size, first = kind & 0xFFFF, kind >> 16, at + 4
        end = at + 8
    else:
        end = first + size + (-size % 8 if padded or kind != _COMPRESSED else 0)
    if size > len(data) - first or (first == at + 4 and size > 4):
        raise ValueError(f"an element of {size} bytes has {len(data) - first} left")
    return _Element(kind, data[first : first + size], end)


@dataclass(frozen=True)
class _Matrix:
    """A variable, or what is in a cell."""

    name: str
    kind: int
    shape: tuple[int, ...]
    parts: Iterator[_Element]
    order: str

    @classmethod
    def of(cls, data: memoryview, order: str) -> _Matrix:
        parts = _elements(data, order, padded=True)
        flags, sizes, name = (next(parts, None) for _ in range(3))
        if flags is None or sizes is None or name is None or len(flags.data) < 4:
            raise ValueError("a variable lacks its size or name")
        word = struct.unpack_from(f"{order}I", flags.data)[0]
        if (word >> 8) & _COMPLEX:
            raise ValueError("a variable is complex")
        shape = tuple(np.frombuffer(sizes.data, f"{order}i4").tolist())
        if not 2 <= len(shape) <= 8 or min(shape) < 0 or math.prod(shape) * 8 > _MOST:
            raise ValueError(f"a variable has the size {shape[:8]}")
        text = bytes(name.data).decode("ascii", "replace")
        return cls(text, word & 0xFF, shape, parts, order)

    def values(self, depth: int = 0) -> NDArray[Any]:
        """Numbers, or matrices as objects, in the shape that MATLAB gives them."""
        if self.kind == _CELL:
            return self._cells(depth)
        if self.kind not in _CLASSES:
            raise ValueError(f"a variable is of class {self.kind}, expected numbers or cells")
        part = next(self.parts, None)
        if part is None or part.kind not in _STORED:
            raise ValueError("a variable has no numbers")
        numbers = np.frombuffer(part.data, f"{self.order}{_STORED[part.kind]}")
        if len(numbers) != math.prod(self.shape):
            raise ValueError(f"a variable of size {self.shape} has {len(numbers)} numbers")
        with np.errstate(invalid="ignore", over="ignore"):
            return numbers.astype(_CLASSES[self.kind]).reshape(self.shape, order="F")

    def _cells(self, depth: int) -> NDArray[Any]:
        if depth == _DEEPEST:
            raise ValueError(f"cells lie more than {_DEEPEST} deep in cells")
        inside: list[NDArray[Any]] = []
        for part in self.parts:
            if part.kind != _MATRIX or len(inside) == math.prod(self.shape):
                raise ValueError("a cell holds something else than its variables")
            inside.append(_Matrix.of(part.data, self.order).values(depth + 1))
        if len(inside) != math.prod(self.shape):
            raise ValueError(f"{len(inside)} cells of {self.shape}")
        found = np.empty(len(inside), dtype=object)
        found[:] = [None] * len(inside)
        for at, values in enumerate(inside):
            found[at] = values
        return found.reshape(self.shape, order="F")


# --- Arrays of MATLAB files: version 5 to 7, and 7.3 (HDF5) with h5py, if it is there -------------

LIMIT = 1024 * MEBIBYTE
_HDF5 = b"\x89HDF\r\n\x1a\n"
_UNREADABLE = (
    *(OSError, ValueError, TypeError, LookupError, EOFError, MemoryError),
    *(RuntimeError, AttributeError, struct.error),
)


def read_mat(path: Path, names: Sequence[str], what: str) -> dict[str, NDArray[Any]]:
    """Those of the named arrays that a file of version 5 to 7 has; cells are arrays of objects.

    Raises:
        InputError: it is missing, too large, damaged, or of version 7.3.
    """
    require_file(path, LIMIT, what)
    try:
        return read_variables(path.read_bytes(), names)
    except (ValueError, struct.error) as error:
        reason = " ".join(str(error).split())[:100]
        raise InputError(
            f"{path}: is no readable MATLAB file of version 5 to 7 ({reason}); expected {what}"
        ) from error


def read_hdf5(path: Path, names: Sequence[str], what: str) -> dict[str, NDArray[Any]]:
    """Those of the named arrays of numbers that a file of version 7.3 has, axes reversed.

    Raises:
        InputError: it is missing, too large or damaged, refers to other files, or h5py is not
            installed.
    """
    require_file(path, LIMIT, what)
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            f"{path}: is a MATLAB file of version 7.3, which needs h5py; pip install "
            "'perfcap[datasets]'"
        ) from error
    try:
        with h5py.File(path, "r") as file:
            return {name: _array(file, name) for name in names if name in file}
    except InputError:
        raise
    except _UNREADABLE as error:
        reason = " ".join(str(error).split())[:100]
        raise InputError(
            f"{path}: is no readable MATLAB file of version 7.3 ({reason}); expected {what}"
        ) from error


def _array(file: Any, name: str) -> NDArray[Any]:
    """An array that lies in the file itself: links out of it would read what nobody named."""
    import h5py

    link, item = file.get(name, getlink=True), None
    if isinstance(link, h5py.HardLink):
        item = file[name]
    if not isinstance(item, h5py.Dataset) or item.external is not None or item.is_virtual:
        raise InputError(f"{file.filename}: {name} is no array that lies in the file")
    size = math.prod(item.shape) * item.dtype.itemsize
    if item.dtype.kind not in "fiu" or size > LIMIT:
        raise InputError(
            f"{file.filename}: {name} is {item.dtype} {item.shape}, expected numbers up to "
            f"{LIMIT // MEBIBYTE} MB"
        )
    values: NDArray[Any] = item[()]
    return values


def is_hdf5(path: Path) -> bool:
    """Whether a file starts as one of version 7.3 may, after MATLAB's header or without it."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        start = file.read(len(_HDF5))
        file.seek(512)
        return _HDF5 in (start, file.read(len(_HDF5)))
