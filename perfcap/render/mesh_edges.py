"""Which triangles meet at the edges of a mesh: found once, used in every frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class MeshEdges:
    """Edges of a triangle mesh with the one or two triangles beside each.

    An edge of more than two triangles appears once for each pair of them that follow each other.

    Attributes:
        faces: (T, 3).
        weld: (V,) the place of each vertex; vertices of one place were split along a seam.
        vertices: (E, 2), end points, as vertices of the first triangle.
        sides: (E, 2), the triangles beside; the second is -1 on an open boundary.
        opposite: (E, 2), the corner of each triangle that is not on the edge; -1 likewise.
        turned: (E,), True where the two triangles disagree about which side is outside.
    """

    faces: Integers
    weld: Integers
    vertices: Integers
    sides: Integers
    opposite: Integers
    turned: NDArray[np.bool_]

    @classmethod
    def build(cls, faces: NDArray[np.integer], weld: NDArray[np.integer] | None = None) -> Self:
        """Edges of ``faces`` (T, 3).

        Args:
            faces: vertex indices; triangles without three different places have no edges.
            weld: (V,) place of each vertex (``Template.weld()[0]``); each its own when not given.

        Raises:
            InputError: shapes or indices that do not fit.
        """
        faces, weld = _checked(faces, weld)
        start, end = faces.reshape(-1), faces[:, [1, 2, 0]].reshape(-1)
        face, third = np.repeat(np.arange(len(faces)), 3), faces[:, [2, 0, 1]].reshape(-1)
        places = weld[faces]
        proper = (places != places[:, [1, 2, 0]]).all(1)[face]
        start, end, face, third = start[proper], end[proper], face[proper], third[proper]
        low, high = np.sort([weld[start], weld[end]], axis=0)
        key = low * (weld.max(initial=0) + 1) + high
        order = np.argsort(key, kind="stable")
        same = key[order[1:]] == key[order[:-1]]
        alone = ~(np.r_[False, same][: len(order)] | np.r_[same, False][: len(order)])
        first = np.concatenate([order[:-1][same], order[alone]])
        second = np.concatenate([order[1:][same], np.full(alone.sum(), -1, np.int64)])
        open_edge = second < 0
        return cls(
            faces,
            weld,
            np.stack([start[first], end[first]], 1),
            np.stack([face[first], np.where(open_edge, -1, face[second])], 1),
            np.stack([third[first], np.where(open_edge, -1, third[second])], 1),
            ~open_edge & (weld[start[first]] == weld[start[second]]),
        )


def _checked(
    faces: NDArray[np.integer], weld: NDArray[np.integer] | None
) -> tuple[Integers, Integers]:
    """Both as int64 arrays of their own, read-only."""
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(
            f"faces has shape {faces.shape} and dtype {faces.dtype}; expected integers (T, 3)"
        )
    count = int(faces.max(initial=-1)) + 1
    places = np.arange(count) if weld is None else weld.astype(np.int64)
    if places.ndim != 1 or len(places) < count or places.min(initial=0) < 0:
        raise InputError(
            f"weld has shape {places.shape} and least entry {places.min(initial=0)}; expected a "
            f"place from 0 for each of at least {count} vertices"
        )
    if faces.min(initial=0) < 0:
        raise InputError(f"faces refers to vertex {faces.min()}; expected indices from 0")
    owned = faces.astype(np.int64)
    owned.flags.writeable = places.flags.writeable = False
    return owned, places
