"""Points of a mesh that make contours in an image.

A contour runs along the edges between a triangle seen from outside and one seen from inside, and
along open boundaries. It is visible where, just beyond it, the z-buffer shows background or
surface further away; the surface on its own side bends steeply towards the camera and says
little. What stands less than a few centimetres in front of other surface (creases, an arm that
lies on the torso) makes no contour to rely on and is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.render import _facing_numba
from perfcap.render.label_map import NEAR, REACH, LabelMap

# --- Which triangles meet at the edges of a mesh: found once, used in every frame -----------------

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


# --- Points of a mesh that make contours in an image ----------------------------------------------

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Rounding to a pixel centre moves a point by up to 0.71 px along its normal, so the first look is
# surely beyond the edge; the second reaches past neighbouring edges where the contour is concave.
_LOOKS = (0.75, 1.5)  # px


@dataclass(frozen=True)
class ModelContour:
    """Visible contour of a mesh in one frame and view.

    Attributes:
        points: (P, 2) px.
        normals: (P, 2), unit, outward: away from the surface the point lies on.
        vertices: (P, 2) int64, the two vertices a point lies between.
        weights: (P, 2), their shares in space, rows sum to one.
        outer: (P,) bool, True on the boundary of the model's silhouette (background beyond it),
            False where the surface stands in front of other surface.
    """

    points: Floats
    normals: Floats
    vertices: Integers
    weights: Floats
    outer: Flags

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, chosen: Flags | Integers) -> ModelContour:
        """Some of the points."""
        return ModelContour(
            self.points[chosen],
            self.normals[chosen],
            self.vertices[chosen],
            self.weights[chosen],
            self.outer[chosen],
        )


def occluding_contour(
    pixels: Floats,
    depth: Floats,
    mesh: MeshEdges,
    label_map: LabelMap,
    spacing: float = 3.0,
    gap: float = 0.03,
) -> ModelContour:
    """Visible contour points of a projected mesh.

    Args:
        pixels: projected vertices, (V, 2) px, pixel centres at integers.
        depth: their depth along the optical axis, (V,) m.
        mesh: its edges.
        label_map: (H, W), the same mesh drawn with no culling, possibly among others; of a part of
            the image, as far as it holds the mesh and 2 px around it.
        spacing: mean distance between points along the contour, px.
        gap: how much further away surface beyond a contour must be, m.

    Returns:
        Points on mesh edges, without those at or beyond the image border. Triangles that the
        z-buffer leaves out (vertices too near, too far outside or not finite) have no contour.

    Raises:
        InputError: shapes that do not fit, or a spacing that is not positive.
    """
    _check(pixels, depth, mesh, label_map, spacing)
    edges, normals = _contour_edges(pixels, depth, mesh)
    normals = _smooth(normals, mesh.weld[mesh.vertices[edges]], pixels[mesh.vertices[edges]])
    contour, distance = _sample(pixels, depth, mesh.vertices[edges], normals, spacing)
    visible, outer = _visible(contour, distance, label_map, gap)
    contour = contour[visible]
    return ModelContour(
        contour.points, contour.normals, contour.vertices, contour.weights, outer[visible]
    )


def _contour_edges(pixels: Floats, depth: Floats, mesh: MeshEdges) -> tuple[Integers, Floats]:
    """Edges between front and back or beside nothing, and their outward normals (E', 2)."""
    front, drawn = np.empty((2, len(mesh.faces)), np.bool_)
    points = np.ascontiguousarray(pixels, np.float64), np.ascontiguousarray(depth, np.float64)
    _facing_numba.facing(*points, mesh.faces, (REACH, NEAR), front, drawn)
    kept = np.empty(len(mesh.sides), np.bool_)
    _facing_numba.folded(front, drawn, mesh.sides, mesh.turned, kept)
    edges = np.flatnonzero(kept)
    return edges, _outward(pixels, mesh, edges)


def _outward(pixels: Floats, mesh: MeshEdges, edges: Integers) -> Floats:
    """Unit normals away from the triangle that reaches furthest from the edge; zero if none."""
    start, end = (pixels[mesh.vertices[edges, k]] for k in range(2))
    along = end - start
    opposite = mesh.opposite[edges]
    reach = _cross(along[:, None], pixels[opposite] - start[:, None])
    reach[opposite < 0] = 0.0
    furthest = np.take_along_axis(reach, np.abs(reach).argmax(1)[:, None], 1)
    # the left-hand perpendicular (-y, x) has a positive cross product with the edge
    normal = -np.sign(furthest) * np.stack([-along[:, 1], along[:, 0]], 1)
    return _unit(normal)


def _smooth(normals: Floats, places: Integers, ends: Floats) -> Floats:
    """Normals at both ends of each edge, (E', 2, 2): means over the contour edges that meet there.

    Edges of a mesh zigzag about the contour of the surface it stands for.
    """
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    names, index = np.unique(places, return_inverse=True)
    index = index.reshape(-1)
    total = np.zeros((len(names), 2))
    np.add.at(total, index, np.repeat(normals * length[:, None], 2, axis=0))
    meeting = _unit(total)[index].reshape(-1, 2, 2)
    # at a cusp, where the contour turns back behind the surface, the mean says nothing
    agree = np.einsum("ekx,ex->ek", meeting, normals) > 0.5
    return np.where(agree[..., None], meeting, normals[:, None])


def _sample(
    pixels: Floats, depth: Floats, vertices: Integers, normals: Floats, spacing: float
) -> tuple[ModelContour, Floats]:
    """Points every ``spacing`` px of total length, whatever the edges' own, and their depth."""
    start, end = pixels[vertices[:, 0]], pixels[vertices[:, 1]]
    length = np.linalg.norm(end - start, axis=1)
    until = np.cumsum(length)
    count = int(until[-1] / spacing) if len(until) else 0
    place = (np.arange(count) + 0.5) * spacing
    edge = np.searchsorted(until, place, side="right")
    share = 1.0 - (until[edge] - place) / length[edge]
    image = np.stack([1.0 - share, share], 1)
    inverse = image / depth[vertices[edge]]  # 1/z is linear in the image
    total = inverse.sum(1)
    points = np.einsum("pk,pkx->px", image, pixels[vertices[edge]])
    normal = _unit(np.einsum("pk,pkx->px", image, normals[edge]))
    outer = np.zeros(count, bool)
    contour = ModelContour(points, normal, vertices[edge], inverse / total[:, None], outer)
    return contour, 1.0 / total


def _visible(
    contour: ModelContour, depth: Floats, label_map: LabelMap, gap: float
) -> tuple[Flags, Flags]:
    """Whether nothing hides a point, and whether background is beyond it."""
    points, normals, surface = contour.points, contour.normals, label_map.depth.numpy(force=True)
    undecided = np.any(normals != 0, axis=1)
    visible, outer = np.zeros(len(points), bool), np.zeros(len(points), bool)
    height, width = surface.shape
    for look in _LOOKS:
        place = np.rint(points + look * normals).astype(np.int64)
        row, column = (place[:, 1 - k] - label_map.corner[k] for k in range(2))
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        undecided &= inside
        beyond = surface[np.where(inside, row, 0), np.where(inside, column, 0)]
        behind = undecided & (beyond > depth + gap)
        visible |= behind
        outer |= behind & np.isinf(beyond)
        undecided &= ~behind & (beyond > depth - gap)
    return visible, outer


def _unit(vectors: Floats) -> Floats:
    """Of length one; zero stays zero."""
    out: Floats = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
    return out


def _cross(a: Floats, b: Floats) -> Floats:
    out: Floats = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def _check(
    pixels: Floats, depth: Floats, mesh: MeshEdges, label_map: LabelMap, spacing: float
) -> None:
    if pixels.shape != (*depth.shape, 2) or depth.ndim != 1 or len(depth) < len(mesh.weld):
        raise InputError(
            f"pixels has shape {pixels.shape} and depth {depth.shape}; expected (V, 2) and (V,) "
            f"for the mesh's {len(mesh.weld)} vertices"
        )
    if label_map.depth.ndim != 2:
        raise InputError(
            f"label_map has shape {tuple(label_map.depth.shape)}; expected one frame (H, W)"
        )
    if not spacing > 0:
        raise InputError(f"spacing is {spacing}; expected a positive distance in pixels")
