"""A pair of sneakers, lofted around the feet they replace."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from actor_bake.assets import NAMES, Body
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_RINGS, _AROUND = 26, 24
_LENGTH_MARGIN = 0.016  # metres the shoe is longer than the foot
_KEEP_ABOVE = 0.060  # metres: what is lower of the bare foot is inside the shoe

# Profile along the shoe, heel 0 to toe 1: half width and height of the upper in metres.
_ALONG = [0, 0.01, 0.03, 0.07, 0.14, 0.30, 0.42, 0.50, 0.60, 0.72, 0.84, 0.92, 0.96, 0.99, 1]
_HALF_WIDTH = [
    0.010, 0.018, 0.026, 0.033, 0.037, 0.038, 0.039, 0.042, 0.047, 0.051, 0.048, 0.040, 0.032,
    0.018, 0.008,
]  # fmt: skip
_HEIGHT = [
    0.050, 0.066, 0.080, 0.088, 0.092, 0.090, 0.094, 0.087, 0.074, 0.063, 0.056, 0.050, 0.045,
    0.036, 0.028,
]  # fmt: skip


def put_on_shoes(body: Body) -> tuple[Body, Floats]:
    """Replace the feet of a dressed body by shoes.

    Returns:
        The body, and shoe coordinates of every vertex (V, 3): share along the shoe from heel to
        toe, metres sideways to the person's left, height in metres; -1 where there is no shoe.
    """
    foot = np.isin(body.island, (4, 5))
    low = body.vertices[body.faces][..., 1].max(1) < _KEEP_ABOVE
    soles = body.vertices[np.unique(body.faces[foot & low])]
    kept = ~(foot & low)
    parts = [_loft(body, soles, side) for side in (1, -1)]
    vertices, bare, uv = _tucked(body), body.bare, body.uv
    faces, face_uv = body.faces[kept], body.face_uv[kept]
    island, weights = body.island[kept], body.weights
    coordinates = np.full((len(vertices), 3), -1.0)
    for number, (points, local, grid) in enumerate(parts):
        triangles = _grid_faces()
        faces = np.concatenate([faces, _welded(triangles) + len(vertices)])
        face_uv = np.concatenate([face_uv, triangles + len(uv)])
        island = np.concatenate([island, np.full(len(triangles), 8 + number)])
        ankle = np.eye(len(NAMES))[NAMES.index("lr"[number] + "_ankle")]
        weights = np.concatenate([weights, np.tile(ankle, (len(points), 1))])
        vertices, bare = np.concatenate([vertices, points]), np.concatenate([bare, points])
        uv = np.concatenate([uv, grid])
        coordinates = np.concatenate([coordinates, local])
    used, compact = np.unique(faces, return_inverse=True)
    shod = replace(
        body,
        vertices=vertices[used],
        bare=bare[used],
        faces=compact.reshape(-1, 3),
        face_uv=face_uv,
        uv=uv,
        island=island,
        weights=weights[used],
    )
    return shod, coordinates[used]


def _tucked(body: Body) -> Floats:
    """Ankles drawn in a little, so that they stay inside the shoes."""
    vertices = body.vertices.copy()
    bare = np.zeros(len(vertices), dtype=bool)
    bare[body.faces[np.isin(body.island, (4, 5))]] = True
    for side, sign in (("l", 1), ("r", -1)):
        ankle = body.joint(f"{side}_ankle")
        mine = bare & (sign * vertices[:, 0] > 0) & (vertices[:, 1] < ankle[1])
        for axis in (0, 2):
            vertices[mine, axis] = ankle[axis] + 0.5 * (vertices[mine, axis] - ankle[axis])
    return vertices


def _loft(body: Body, soles: Floats, side: int) -> tuple[Floats, Floats, Floats]:
    """Points of one shoe, their shoe coordinates and texture grid."""
    mine = soles[side * soles[:, 0] > 0]
    prefix = "l" if side > 0 else "r"
    ankle, toe = (body.joint(f"{prefix}_{part}") for part in ("ankle", "toe"))
    forward = (toe - ankle) * (1, 0, 1)
    forward /= np.linalg.norm(forward)
    left = np.cross([0.0, 1.0, 0.0], forward)
    along = (mine - ankle) @ forward
    heel, tip = along.min() - _LENGTH_MARGIN / 2, along.max() + _LENGTH_MARGIN / 2
    across = (mine - ankle) @ left
    bend = _centre_line(along, across)
    # Rings crowd at heel and tip, where the outline turns quickly.
    share = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, _RINGS))
    reach = heel + share * (tip - heel)
    middle = np.interp(reach, *bend)
    local = np.stack([_ring(s) for s in share])  # rings, around, (side, height)
    points = ankle * (1, 0, 1) + reach[:, None, None] * forward
    points = points + (middle[:, None, None] + local[..., :1]) * left
    points = points + local[..., 1:] * np.array([0.0, 1.0, 0.0])
    coordinates = np.concatenate(
        [np.broadcast_to(share[:, None, None], (*local.shape[:2], 1)), local], -1
    )
    turn = np.linspace(0, 1, _AROUND + 1)
    grid = np.stack(np.broadcast_arrays(share[:, None], turn), -1).reshape(-1, 2)
    return points.reshape(-1, 3), coordinates.reshape(-1, 3), grid * (1.5, 1.5)


def _centre_line(along: Floats, across: Floats) -> tuple[Floats, Floats]:
    """Middle of the foot's outline along its length: feet bend inwards at the toes."""
    edges = np.linspace(along.min(), along.max(), 9)
    middles = []
    for low, high in pairwise(edges):
        inside = across[(along >= low - 1e-9) & (along <= high + 1e-9)]
        middles.append(0.5 * (inside.min() + inside.max()))
    smooth = np.convolve(np.pad(middles, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid")
    return 0.5 * (edges[:-1] + edges[1:]), smooth


def _ring(share: float) -> Floats:
    """Cross-section at a share of the length: flat sole, rounded upper, (around, 2) metres.

    The ring starts and ends at the middle of the sole, where the texture seam is hidden.
    """
    width = float(np.interp(share, _ALONG, _HALF_WIDTH))
    height = float(np.interp(share, _ALONG, _HEIGHT))
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, _AROUND, endpoint=False)
    flat = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** 0.55
    rise = np.sin(angle)
    # Below the middle: a sole with straight walls. Above: an upper that narrows to the top.
    y = np.where(rise < 0, 0.022 * (1 - np.abs(rise) ** 0.5), 0.022 + (height - 0.022) * rise)
    waist = np.where(rise > 0, 1 - 0.30 * rise, 1.0) * np.where(rise < 0, 1.04, 1.0)
    spring = 0.010 * np.clip((share - 0.8) / 0.2, 0, 1) ** 2  # the toe lifts off the floor
    return np.stack([width * waist * flat, y + spring], axis=-1)


def _grid_faces() -> Integers:
    """Triangles over the texture grid of rings and around + 1 columns, with two end fans."""
    columns = _AROUND + 1
    start = np.arange(_RINGS - 1)[:, None] * columns + np.arange(_AROUND)
    one, two, three, four = start, start + 1, start + columns, start + columns + 1
    faces = [np.stack([one, two, three], -1), np.stack([two, four, three], -1)]
    body = np.concatenate([part.reshape(-1, 3) for part in faces])
    first, last = np.arange(_AROUND), (_RINGS - 1) * columns + np.arange(_AROUND)
    heel = np.stack([np.full(_AROUND - 2, first[0]), first[2:], first[1:-1]], -1)
    tip = np.stack([np.full(_AROUND - 2, last[0]), last[1:-1], last[2:]], -1)
    return np.concatenate([body, heel, tip])


def _welded(faces: Integers) -> Integers:
    """Grid corners to ring points: the last column is the first one again."""
    ring, column = np.divmod(faces, _AROUND + 1)
    return ring * _AROUND + column % _AROUND
