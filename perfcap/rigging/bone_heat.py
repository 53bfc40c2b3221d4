"""Skinning weights of a bare mesh as heat from its bones (Baran and Popovic 2007, Sec. 4).

A place takes the temperature of its nearest bone if nothing stands between them, and heat flows
along the surface: ``-laplacian(w) + H (w - p) = 0`` with H = 1 / d^2 for a place that sees its
nearest bone at distance d, otherwise 0. Parts that mostly do not see a bone (a skirt over legs,
hair, shoes over feet, buttons) take the weights of what they lie on in the same way: d is their
distance to it, and p its weights there. Close cloth thus moves with the body, and what hangs
far away from it is smooth.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from perfcap.actor.template import INFLUENCES
from perfcap.array_checks import require_indices, require_shape
from perfcap.errors import InputError
from perfcap.geometry.laplacian import laplacian
from perfcap.geometry.surface_topology import SurfaceTopology, surface_topology
from perfcap.rigging import _sight_numba
from perfcap.rigging.bones import Bones
from perfcap.rigging.overrides import Override

# --- Heat on a triangle mesh ----------------------------------------------------------------------

_LOG = logging.getLogger(__name__)
_NONE = 1e-6  # weight that moves nothing
Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def conduct(
    matrix: csr_array, area: Floats, heat: Floats, sources: Floats, free: NDArray[np.bool_]
) -> Floats:
    """Heat equilibrium ``(L + M H) w = M H p`` on some of the places, the others left out.

    Args:
        matrix: L, (U, U).
        area: M, (U,).
        heat: H, conductance to the source, (U,), per square metre.
        sources: p, (U, J).
        free: which places are solved; they conduct among themselves only. Every connected part
            needs heat somewhere.

    Returns:
        w of the free places, (N, J).
    """
    index = np.flatnonzero(free)
    part = matrix[index][:, index]
    part = part - diags_array(np.asarray(part.sum(1)).ravel())  # nothing flows to what is left out
    inflow = area[index] * heat[index]
    return _solve(part + diags_array(inflow), inflow[:, None] * sources[index])


def smooth(matrix: csr_array, area: Floats, values: Floats, reach: Floats) -> Floats:
    """Blur values (U, J) over about ``reach`` metres, (U,): ``(M + r L r) w = M v``, one step."""
    scaled = diags_array(reach) @ matrix @ diags_array(reach)
    # with a reach that varies the rows do not sum to zero any more; restore that
    scaled = scaled - diags_array(np.asarray(scaled.sum(1)).ravel())
    return _solve(scaled + diags_array(area), area[:, None] * values)


def _solve(matrix: csr_array, right: Floats) -> Floats:
    options = {"SymmetricMode": True}
    factor = splu(
        csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
    )
    solved: Floats = factor.solve(np.ascontiguousarray(right))
    return solved


# --- Skinning weights of a bare mesh as heat from its bones (Baran and Popovic 2007, Sec. 4) ------

Flags = NDArray[np.bool_]

HEAT = 2.0  # at 1, as published, shares reach farther; measured best from 0.5 to 4 by eye and error
_TIE = 1.0001  # bones this much farther than the nearest one count as nearest
_CLOSEST = 2e-3  # metres: nearer bones and skins are as good as this near
_SUPPORTED = 0.3  # parts of which this share of the area sees a bone are heated by bones
_NEIGHBORS = 4  # places of the body that a place of a carried part looks at
_CHUNK = 20_000


@dataclass(frozen=True, eq=False)
class HeatReport:
    """How the weights came about.

    Attributes:
        seen: share of the area that sees its nearest bone.
        parts: connected parts of the mesh.
        carried: parts that took the weights of what they lie on.
        loose: vertices of no triangle.
    """

    seen: float
    parts: int
    carried: int
    loose: int


def bone_heat_weights(
    vertices: Floats,
    faces: NDArray[np.int64],
    bones: Bones,
    overrides: tuple[Override, ...] = (),
    heat: float = HEAT,
) -> tuple[Floats, HeatReport]:
    """Skinning weights (V, J): not negative, rows sum to one.

    The mesh may have holes, several parts, edges of more than two triangles, and triangles without
    area; vertices at one position move as one. Bones left without any by overrides are logged.

    Args:
        vertices: rest pose, (V, 3), metres.
        faces: (T, 3).
        bones: of the skeleton, in the same pose.
        overrides: regions that only some bones may move.
        heat: factor on H; smaller is smoother.

    Raises:
        InputError: the arrays are no mesh, no part of it sees a bone, or bones are not those of
            the mesh: in another unit, or with another axis up.
    """
    weights, report = heated(vertices, faces, bones, overrides, heat)
    bones.require_near(vertices[np.unique(faces)])
    still = [name for name, most in zip(bones.names, weights.max(0), strict=True) if most <= _NONE]
    if overrides and still:
        what = "move no vertex: overrides cover too much; part 0 is the largest, mostly the body"
        _LOG.warning("%s %s", ", ".join(still), what)
    return weights, report


def heated(
    vertices: Floats,
    faces: NDArray[np.int64],
    bones: Bones,
    overrides: tuple[Override, ...] = (),
    heat: float = HEAT,
) -> tuple[Floats, HeatReport]:
    """``bone_heat_weights`` of bones that are those of the mesh."""
    topology = surface_topology(vertices, faces)
    mesh = _Mesh.of(vertices, topology)
    allowed = _allowed(mesh, bones, overrides)
    strength, sources = _from_bones(mesh, bones, allowed)
    supported = _supported(mesh, strength > 0)
    seen = float(mesh.area[strength > 0].sum() / mesh.area.sum())
    weights = np.zeros(sources.shape)
    weights[supported] = conduct(mesh.matrix, mesh.area, heat * strength, sources, supported)
    carried = ~supported & (topology.component >= 0)
    if carried.any():
        strength, sources = _from_surface(mesh.places, weights, supported, allowed)
        weights[carried] = conduct(mesh.matrix, mesh.area, heat * strength, sources, carried)
    loose = topology.component < 0
    if loose.any():
        at = cKDTree(mesh.places[~loose]).query(mesh.places[loose])[1]
        weights[loose] = weights[~loose][at]
    weights = _restricted(mesh, weights, allowed, overrides)
    parts = len(np.unique(topology.component[carried]))
    report = HeatReport(seen, topology.components, parts, int(loose[topology.place].sum()))
    return fewest(weights)[topology.place], report


def fewest(weights: Floats, influences: int = INFLUENCES) -> Floats:
    """Weights (U, J) of which at most ``influences`` a row are left, without creases.

    Dropping the rest makes weights jump where bones change ranks, which shows as folds in the
    skin. Instead all weights are lowered by the largest one that has to go: that is continuous.
    """
    if weights.shape[1] <= influences:
        return weights
    threshold = np.sort(weights, axis=1)[:, -influences - 1, None]
    lowered = np.maximum(weights - threshold, 0.0)
    total = lowered.sum(1, keepdims=True)
    # more bones than that with equal shares: nothing is left, so the first of them stay
    first = np.argsort(-weights, axis=1, kind="stable")[:, :influences]
    kept = np.zeros_like(weights)
    np.put_along_axis(kept, first, np.take_along_axis(weights, first, 1), 1)
    chosen = np.where(total > 1e-12, lowered, kept)
    return np.asarray(chosen / chosen.sum(1, keepdims=True))


@dataclass(frozen=True, eq=False)
class _Mesh:
    """Places of a mesh and how heat flows between them."""

    places: Floats
    topology: SurfaceTopology
    matrix: csr_array
    area: Floats

    @classmethod
    def of(cls, vertices: Floats, topology: SurfaceTopology) -> _Mesh:
        if topology.components == 0:
            raise InputError("mesh has no triangle with three corners; give a mesh with faces")
        places = vertices[topology.representative]
        return cls(places, topology, *laplacian(places, topology.faces))


def _allowed(mesh: _Mesh, bones: Bones, overrides: tuple[Override, ...]) -> Flags:
    """Bones that may move each place, (U, J); later overrides win."""
    allowed = np.ones((len(mesh.places), len(bones.names)), dtype=np.bool_)
    for override in overrides:
        inside = override.covers(mesh.places, mesh.topology.component)
        if not inside.any():
            raise InputError(
                f"override {override.name!r} covers no vertex of the mesh; its "
                f"{mesh.topology.components} parts lie from {mesh.places.min(0).round(2)} to "
                f"{mesh.places.max(0).round(2)} m"
            )
        allowed[inside] = np.isin(bones.names, override.bones)
    return allowed


def _from_bones(mesh: _Mesh, bones: Bones, allowed: Flags) -> tuple[Floats, Floats]:
    """H (U,) per square metre and p (U, J): the nearest bones, where nothing hides them."""
    sight = Sight(mesh.places, mesh.topology.faces)
    strength, sources = np.zeros(len(mesh.places)), np.zeros(allowed.shape)
    for start in range(0, len(mesh.places), _CHUNK):
        rows = np.arange(start, min(start + _CHUNK, len(mesh.places)))
        near, distance = bones.nearest_points(mesh.places[rows])
        distance = np.where(allowed[rows][:, bones.owner], distance, np.inf)
        least = distance.min(1)
        row, segment = np.nonzero(distance <= _TIE * least[:, None])
        hidden = sight.blocked(mesh.places[rows[row]], near[row, segment], rows[row])
        row, segment = row[~hidden], segment[~hidden]
        sources[rows[row], bones.owner[segment]] = 1.0
        strength[rows[row]] = np.maximum(least[row], _CLOSEST) ** -2.0
    return strength, sources / np.maximum(sources.sum(1, keepdims=True), 1.0)


def _supported(mesh: _Mesh, seen: Flags) -> Flags:
    """Places of parts that see their bones well enough to be heated by them, (U,)."""
    component, parts = mesh.topology.component, mesh.topology.components
    on = component >= 0
    total = np.bincount(component[on], mesh.area[on], parts)
    lit = np.bincount(component[on], (mesh.area * seen)[on], parts)
    if not lit.any():
        raise InputError(
            "no vertex of the mesh sees a bone; check that the joints lie inside the mesh"
        )
    enough = lit >= _SUPPORTED * total
    enough[np.argmax(lit)] = True
    return np.asarray(on & enough[component])


def _from_surface(
    places: Floats, weights: Floats, supported: Flags, allowed: Flags
) -> tuple[Floats, Floats]:
    """H (U,) and p (U, J) of places that lie on a surface whose weights are known."""
    known = np.flatnonzero(supported)
    count = min(_NEIGHBORS, len(known))
    distance, at = cKDTree(places[known]).query(places, k=range(1, count + 1))
    share = 1 / np.maximum(distance, _CLOSEST) ** 2
    share /= share.sum(1, keepdims=True)
    sources = (share[..., None] * weights[known[at]]).sum(1)
    return np.maximum(distance[:, 0], _CLOSEST) ** -2.0, _only(sources, allowed)


def _restricted(
    mesh: _Mesh, weights: Floats, allowed: Flags, overrides: tuple[Override, ...]
) -> Floats:
    """Weights of allowed bones alone, blurred over the regions of overrides and their seams."""
    weights = _only(weights, allowed)
    for override in overrides:
        if not override.blend:
            continue
        inside = override.covers(mesh.places, mesh.topology.component)
        edges = mesh.topology.edges
        seam = edges[inside[edges].any(1)]
        reach = np.zeros(len(inside))
        reach[seam] = override.blend
        reach[inside] = override.blend
        weights = smooth(mesh.matrix, mesh.area, weights, reach)
    weights = np.maximum(weights, 0.0)
    return np.asarray(weights / weights.sum(1, keepdims=True))


def _only(weights: Floats, allowed: Flags) -> Floats:
    """Weights without bones that are not allowed; equal shares where nothing is left."""
    kept = np.where(allowed, np.maximum(weights, 0.0), 0.0) + 1e-9 * allowed
    return np.asarray(kept / kept.sum(1, keepdims=True))


# --- Whether a mesh stands between two points -----------------------------------------------------

_MOST_CELLS = 4_000_000
_EDGES_A_CELL = 2.0  # cells are about this many edges wide


class Sight:
    """Line of sight through the triangles of a mesh, found through a uniform grid.

    Args:
        places: (U, 3), metres.
        faces: (T, 3).

    Raises:
        InputError: places that are not finite, or faces of others.
    """

    def __init__(self, places: Floats, faces: Integers) -> None:
        _require_places(places, "places", len(places))
        require_shape(faces, "faces", (None, 3), "(T, 3)")
        require_indices(faces, "faces", len(places), "places")
        self._faces = np.ascontiguousarray(faces)
        self._corners = np.ascontiguousarray(places[faces])
        low, high = places.min(0) - 1e-6, places.max(0) + 1e-6
        edge = np.linalg.norm(self._corners - np.roll(self._corners, 1, 1), axis=-1)
        cell = _EDGES_A_CELL * float(np.median(edge)) if len(edge) else 1.0
        cell = max(cell, float(np.prod(high - low) / _MOST_CELLS) ** (1 / 3), 1e-9)
        shape = np.ceil((high - low) / cell).astype(np.int64).clip(min=1)
        while np.prod(shape.astype(float)) > _MOST_CELLS:
            cell *= 1.3
            shape = np.ceil((high - low) / cell).astype(np.int64).clip(min=1)
        self._grid = (low, cell, shape)
        self._cells = _sight_numba.cells_of(self._corners, *self._grid)

    def blocked(self, starts: Floats, ends: Floats, own: Integers) -> Flags:
        """Whether a triangle lies between starts and ends, (N, 3) each; (N,).

        Args:
            starts: points, metres.
            ends: points, metres.
            own: the place each start is at, (N,); triangles at it never block. -1 for none.

        Raises:
            InputError: arrays of different lengths, or points that are not finite.
        """
        for name, points in (("starts", starts), ("ends", ends)):
            _require_places(points, name, len(starts))
        require_shape(own, "own", (len(starts),), "(N,), of each start")
        starts, ends = (np.ascontiguousarray(p, dtype=np.float64) for p in (starts, ends))
        hidden: Flags = _sight_numba.blocked(
            starts, ends, own, self._corners, self._faces, *self._grid, *self._cells
        )
        return hidden


def _require_places(places: Floats, name: str, count: int) -> None:
    """No number is no cell of a grid."""
    require_shape(places, name, (count, 3), "(N, 3), metres")
    if not np.isfinite(places).all():
        raise InputError(f"{name} are not all finite; expected metres")
