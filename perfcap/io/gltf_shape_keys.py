"""Morph targets of a glTF file at their default weights, which are part of the body it shows.

Every viewer adds the weighted offsets of a primitive's targets to its vertices before it skins
them: ``p = p0 + sum_k w_k d_k``. Programs that make people (MPFB, VRoid) keep shapes of bodies and
faces like that. Weights of animations are left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.io.gltf_document import Document, Object

Floats = NDArray[np.float64]

_MOST_TARGETS = 4096  # of a mesh
_MOST_OFFSETS = 1 << 26  # read of one file: some seconds, however often it names the same ones
_FARTHEST = float(np.finfo(np.float32).max)  # what positions themselves can hold


class ShapeKeys:
    """What default weights make of the vertices of a file; counts how much it has read.

    Attributes:
        document: the file.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self._left = _MOST_OFFSETS

    def applied(self, vertices: Floats, primitive: Object, weights: object) -> Floats:
        """Vertices of a primitive as viewers show them.

        Args:
            vertices: of its ``POSITION``, (V, 3).
            primitive: with its targets, if it has any.
            weights: as ``default_weights`` found them.

        Raises:
            InputError: targets, weights or offsets that are damaged, do not belong to these
                vertices, or are too many.
        """
        targets = primitive.get("targets")
        if not targets or weights is None:
            return vertices
        given = self._weights(weights)
        if not given.any():
            return vertices
        if not isinstance(targets, list) or len(targets) != len(given):
            found = len(targets) if isinstance(targets, list) else "no list of"
            raise self.document.error(
                f"damaged file, {len(given)} weights for {found} morph targets; export it again"
            )
        shaped = vertices.copy()
        with np.errstate(invalid="ignore", over="ignore"):  # refused below
            for place in np.flatnonzero(given):
                shaped += given[place] * self._offsets(targets[place], len(vertices))
        if not np.abs(shaped).max() <= _FARTHEST:
            raise self.document.error(
                "morph targets at their default weights take vertices to NaN or infinity; export "
                "it again"
            )
        return shaped

    def _weights(self, weights: object) -> Floats:
        if not isinstance(weights, list):
            raise self.document.error("damaged file, weights of morph targets are not a list")
        count = len(weights)
        if count > _MOST_TARGETS:
            raise self.document.error(
                f"{count} morph targets of a mesh; at most {_MOST_TARGETS} are read"
            )
        self._spend(count)
        return self.document.numbers(weights, count, "weights of morph targets")

    def _offsets(self, target: object, rows: int) -> Floats | float:
        if not isinstance(target, dict):
            raise self.document.error("damaged file, a morph target is not an object")
        if "POSITION" not in target:
            return 0.0
        self._spend(rows)
        return _dense(self.document, target["POSITION"], rows).astype(np.float64)

    def _spend(self, rows: int) -> None:
        self._left -= rows
        if self._left < 0:
            raise self.document.error(
                f"its morph targets have more than {_MOST_OFFSETS} offsets of non-zero weight; "
                "apply them to the mesh, and export it again"
            )


def default_weights(node: Object, mesh: Object) -> object:
    """Weights of the morph targets of a node's mesh as the file has them; None if it has none."""
    return node["weights"] if "weights" in node else mesh.get("weights")


def _dense(document: Document, index: object, rows: int) -> NDArray[Any]:
    """Offsets of so many vertices, (rows, 3): what an accessor leaves out is zero."""
    accessor, what = document.item("accessors", index), f"accessor {index} of a morph target"
    if accessor.get("count") != rows:
        raise document.error(f"{what} has {accessor.get('count')!r:.20} rows for {rows} vertices")
    values = np.zeros((rows, 3))
    if "bufferView" in accessor:
        values = document.values(accessor, "VEC3", what)
    if "sparse" in accessor:
        places, changed = _sparse(document, accessor, rows, what)
        values[places] = changed
    return values


def _sparse(
    document: Document, accessor: Object, rows: int, what: str
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Rows that a sparse accessor changes, and what they are."""
    sparse = accessor["sparse"]
    names = ("count", "indices", "values")
    count, places, values = (sparse.get(n) if isinstance(sparse, dict) else None for n in names)
    if not isinstance(places, dict) or not isinstance(values, dict):
        raise document.error(f"damaged file, {what} has no sparse indices and values")
    size = {"count": document.integer(count, f"{what} sparse count", 1, rows)}
    index = document.values({**places, **size, "type": "SCALAR"}, "SCALAR", what)[:, 0]
    if index.dtype.kind != "u" or index.max() >= rows:
        raise document.error(f"damaged file, {what} names vertex {index.max()} of {rows}")
    form = {key: accessor.get(key) for key in ("componentType", "normalized", "type")}
    return index, document.values({**values, **size, **form}, "VEC3", what)
