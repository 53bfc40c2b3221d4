"""OFF meshes: text with the number of vertices and faces, vertices, faces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, read_text

_LIMIT = 256 * MEBIBYTE
_MAX_VERTICES = 4_000_000
_WHAT = "an OFF mesh"


def read_off(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) in the file's unit and triangles (T, 3); polygons are cut into triangles.

    Raises:
        InputError: it is no such file.
    """
    lines = (line.split("#")[0] for line in read_text(path, _WHAT, _LIMIT).splitlines())
    words = [line.split() for line in lines if line.strip()]
    if not words or words[0][0] not in ("OFF", "COFF", "NOFF"):
        raise InputError(f"{path}: does not start with OFF; expected {_WHAT}")
    rows = [words[0][1:], *words[1:]] if len(words[0]) > 1 else words[1:]
    try:
        vertices, faces = (int(value) for value in rows[0][:2])
        if not (0 < vertices <= _MAX_VERTICES and faces > 0 and len(rows) > vertices + faces):
            raise InputError(
                f"{path}: says {vertices} vertices and {faces} faces in {len(rows)} lines; "
                f"expected {_WHAT}, whole"
            )
        points = np.array([[float(value) for value in row[:3]] for row in rows[1 : vertices + 1]])
        corners = [_corners(row) for row in rows[vertices + 1 : vertices + faces + 1]]
        triangles = np.array([t for polygon in corners for t in polygon], np.int64).reshape(-1, 3)
    except (ValueError, IndexError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: holds a line that is no {_WHAT[3:]} ({error})") from error
    if points.shape != (vertices, 3) or not np.isfinite(points).all():
        raise InputError(f"{path}: has vertices that are not three finite numbers")
    if not len(triangles) or triangles.min() < 0 or triangles.max() >= vertices:
        raise InputError(f"{path}: has faces of vertices that are not among the {vertices}")
    return points, triangles


def _corners(row: list[str]) -> list[tuple[int, int, int]]:
    """A polygon as a fan of triangles."""
    count = int(row[0])
    indices = [int(value) for value in row[1 : count + 1]]
    if count < 3 or len(indices) != count:
        raise ValueError(f"a face of {count} corners with {len(indices)} numbers")
    return [(indices[0], indices[i], indices[i + 1]) for i in range(1, count - 1)]
