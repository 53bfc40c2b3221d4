"""Arrays of MATLAB files: version 5 to 7, and 7.3 (HDF5) with h5py, if it is there."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.datasets.mat_file import read_variables
from perfcap.io.files import MEBIBYTE, require_file

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
