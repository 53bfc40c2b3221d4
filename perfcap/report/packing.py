"""Arrays as text inside a page: concatenated, deflated, in base64."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TYPES = {"uint8", "uint16", "int16", "uint32", "float32"}  # what a browser has arrays of
_ALIGNMENT = 4  # bytes: arrays in a browser start at multiples of their items' size


@dataclass(frozen=True)
class Pack:
    """Arrays in one piece of text.

    Attributes:
        text: base64 of the deflated bytes.
        entries: of each array by name: its type, its shape, and where it starts, for JSON.
    """

    text: str
    entries: dict[str, dict[str, Any]]


def pack(arrays: Mapping[str, NDArray[Any]]) -> Pack:
    """Put arrays together; little-endian, row by row.

    Raises:
        ValueError: an array of a type that browsers do not have.
    """
    entries: dict[str, dict[str, Any]] = {}
    parts: list[bytes] = []
    offset = 0
    for name, array in arrays.items():
        if array.dtype.name not in _TYPES:
            known = ", ".join(sorted(_TYPES))
            raise ValueError(f"{name} is {array.dtype}, expected one of {known}")
        data = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes()
        data += bytes(-len(data) % _ALIGNMENT)
        entries[name] = {"type": array.dtype.name, "shape": list(array.shape), "start": offset}
        parts.append(data)
        offset += len(data)
    deflated = zlib.compress(b"".join(parts), 9)
    return Pack(encode(deflated), entries)


def unpack(packed: Pack) -> dict[str, NDArray[Any]]:
    """The arrays of a pack, as a browser reads them."""
    data = zlib.decompress(base64.b64decode(packed.text))
    return {
        name: np.frombuffer(
            data, entry["type"], int(np.prod(entry["shape"], dtype=np.int64)), entry["start"]
        ).reshape(entry["shape"])
        for name, entry in packed.entries.items()
    }


def encode(data: bytes) -> str:
    """Base64, which needs no escaping in HTML."""
    return base64.b64encode(data).decode("ascii")
