"""Records that are appended to a file one by one; what a kill cuts off is dropped.

A record is a mapping of names to arrays of plain numbers, or to what JSON can say. Nothing in a
journal is executed, and a damaged one ends at its last whole record.
"""

from __future__ import annotations

import json
import math
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from perfcap.io.atomic import unwritable

Record = Mapping[str, Any]

_FRAME = struct.Struct("<4sQI")  # what it is, bytes of a record, their checksum
_MAGIC = b"pcj1"
_KINDS = "biuf"


class Journal:
    """The records of one stage of work.

    Example:
        >>> import numpy as np, tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "stage.log"
        >>> Journal(path).append({"values": np.arange(3), "name": "first"})
        >>> [record["name"] for record in Journal(path).records()]
        ['first']
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def records(self) -> Iterator[dict[str, Any]]:
        """Whole records in the order of writing; reading is done before anything is appended."""
        end = 0
        try:
            with self.path.open("rb") as file:
                while (data := _read(file)) is not None:
                    end = file.tell()
                    yield decode(data)
        except FileNotFoundError:
            return
        if end < self.path.stat().st_size:
            os.truncate(self.path, end)

    def append(self, record: Record) -> None:
        """Write a record; a kill of this process does not lose it.

        Raises:
            InputError: the disk refuses.
        """
        data = encode(record)
        try:
            with self.path.open("ab") as file:
                file.write(_FRAME.pack(_MAGIC, len(data), zlib.crc32(data)) + data)
        except OSError as error:
            raise unwritable(self.path, error) from error


def encode(record: Record) -> bytes:
    """A record as bytes: sizes, names and JSON first, numbers behind."""
    arrays = {name: value for name, value in record.items() if isinstance(value, np.ndarray)}
    head = {
        "plain": {name: value for name, value in record.items() if name not in arrays},
        "arrays": [[name, value.dtype.str, value.shape] for name, value in arrays.items()],
    }
    text = json.dumps(head, separators=(",", ":")).encode()
    numbers = [np.ascontiguousarray(value).tobytes() for value in arrays.values()]
    return b"".join((struct.pack("<I", len(text)), text, *numbers))


def decode(data: bytes) -> dict[str, Any]:
    """The record that ``encode`` made bytes of.

    Raises:
        ValueError: they are something else.
    """
    try:
        (size,) = struct.unpack_from("<I", data)
        head = json.loads(data[4 : 4 + size])
        at, record = 4 + size, dict(head["plain"])
        for name, kind, shape in head["arrays"]:
            dtype = np.dtype(kind)
            count = math.prod(shape)
            if dtype.kind not in _KINDS or not 0 <= count * dtype.itemsize <= len(data) - at:
                raise ValueError(f"an array of {kind} {shape}")
            record[name] = np.frombuffer(data, dtype, count, at).reshape(shape).copy()
            at += count * dtype.itemsize
    except (LookupError, TypeError, AttributeError, struct.error, RecursionError) as error:
        raise ValueError(f"no record ({error})") from error
    return record


def _read(file: BinaryIO) -> bytes | None:
    """The next record; None at the end, and where the rest is damaged."""
    head = file.read(_FRAME.size)
    if len(head) < _FRAME.size:
        return None
    magic, size, checksum = _FRAME.unpack(head)
    left = os.fstat(file.fileno()).st_size - file.tell()
    if magic != _MAGIC or size > left:
        return None
    data = file.read(size)
    return data if zlib.crc32(data) == checksum else None
