"""The binary buffer of a glTF file under construction, with its views and accessors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Object = dict[str, Any]

ARRAY_BUFFER, ELEMENT_BUFFER = 34962, 34963  # what a view is for
_COMPONENTS = {"u1": 5121, "u2": 5123, "u4": 5125, "f4": 5126}
_WIDTH_NAMES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def index_type(count: int) -> str:
    """Smallest type of indices below ``count``; the largest number of a type is reserved."""
    return "u2" if count < 65535 else "u4"


@dataclass(eq=False)
class Buffer:
    """Bytes, views and accessors, appended to in the order of the file."""

    data: bytearray = field(default_factory=bytearray)
    views: list[Object] = field(default_factory=list)
    accessors: list[Object] = field(default_factory=list)

    def add_bytes(self, data: bytes, target: int | None = None) -> int:
        """Append a four-byte aligned view; returns its index."""
        view: Object = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(view if target is None else view | {"target": target})
        self.data += data + bytes(-len(data) % 4)
        return len(self.views) - 1

    def add(
        self, values: NDArray[Any], dtype: str, target: int | None = None, bounds: bool = False
    ) -> int:
        """Append an accessor over rows of ``values``; returns its index."""
        rows = _rows(values, dtype)
        accessor: Object = {
            "bufferView": self.add_bytes(rows.tobytes(), target),
            "componentType": _COMPONENTS[dtype],
            "count": len(rows),
            "type": _WIDTH_NAMES[rows.shape[1]],
        }
        return self._append(accessor, rows if bounds else None)

    def add_sparse(self, values: NDArray[Any], dtype: str, kept: NDArray[np.int64]) -> int:
        """Append an accessor with bounds that stores only the rows ``kept``, at least one.

        The other rows are zero.
        """
        rows = _rows(values, dtype)
        small = index_type(len(rows))
        stored = np.zeros_like(rows)
        stored[kept] = rows[kept]
        accessor: Object = {
            "componentType": _COMPONENTS[dtype],
            "count": len(rows),
            "type": _WIDTH_NAMES[rows.shape[1]],
            "sparse": {
                "count": len(kept),
                "indices": {
                    "bufferView": self.add_bytes(kept.astype("<" + small).tobytes()),
                    "componentType": _COMPONENTS[small],
                },
                "values": {"bufferView": self.add_bytes(rows[kept].tobytes())},
            },
        }
        return self._append(accessor, stored)

    def _append(self, accessor: Object, bounded: NDArray[Any] | None) -> int:
        if bounded is not None:
            accessor |= {"min": bounded.min(0).tolist(), "max": bounded.max(0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _rows(values: NDArray[Any], dtype: str) -> NDArray[Any]:
    return np.ascontiguousarray(values.reshape(len(values), -1), dtype="<" + dtype)
