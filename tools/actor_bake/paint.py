"""The texture: clothes, skin, hair and eyes as functions of the place on the bare body.

Colours are flat, without light and shadow, and depend on three-dimensional places rather than on
texture coordinates, so that they continue across seams.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from actor_bake.assets import Body, load_mask
from actor_bake.dress import Outfit, Points, arm_share, measure
from actor_bake.raster import rasterize, sample
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Color = tuple[float, float, float]

_SKIN: Color = (203, 150, 117)
_FLUSH: Color = (196, 122, 98)
_LIPS: Color = (172, 98, 86)
_LASHES: Color = (44, 30, 26)
_HAIR: Color = (52, 35, 27)
_CREAM: Color = (236, 228, 210)
_NAVY: Color = (34, 54, 98)
_RUST: Color = (168, 84, 52)
_RUST_SEAM: Color = (128, 60, 38)
_SNEAKER: Color = (70, 112, 122)
_SOLE_WHITE: Color = (238, 236, 230)
_SOFT = 0.0014  # metres over which colours change at an edge: about one texel of the cloth


@dataclass(frozen=True, eq=False)
class _Texels:
    """What the painter knows of n texels."""

    points: Points
    outfit: Outfit  # where the hems are, on the bare body
    print_height: Floats  # metres from the hem of the shirt, on the cloth as it is worn, (n,)
    island: Integers  # (n,)
    source: Floats  # original texture coordinates with the origin at the top left, (n, 2)
    shoe: Floats  # shoe coordinates, (n, 3)
    noise: Noise


class Noise:
    """Smooth random values in [-1, 1] over space."""

    def __init__(self, seed: int) -> None:
        self.lattice = np.random.default_rng(seed).uniform(-1, 1, (32, 32, 32))

    def __call__(self, places: Floats, cell: float | tuple[float, float, float]) -> Floats:
        """Values at places (n, 3) with bumps of ``cell`` metres along each axis, (n,)."""
        scaled = places / np.asarray(cell)
        low = np.floor(scaled).astype(int)
        part = scaled - low
        part = part * part * (3 - 2 * part)
        total = np.zeros(len(places))
        for corner in np.ndindex(2, 2, 2):
            weight = np.abs(1 - np.array(corner) - part).prod(1)
            total += weight * self.lattice[tuple(((low + corner) % 32).T)]
        return total


def paint(
    body: Body, worn: Floats, shoe: Floats, uv: Floats, size: int, seed: int
) -> NDArray[np.uint8]:
    """Texture of a body, (size, size, 3).

    Args:
        body: the bare body with its shoes.
        worn: where its vertices are in clothes, standing barefoot, (V, 3): prints follow cloth.
        shoe: shoe coordinates of its vertices, (V, 3).
        uv: texture coordinates of its corners in the atlas, origin at the bottom left, (N, 2).
        size: pixels a side.
        seed: of the noise.
    """
    flat = uv[body.face_uv] * (size, -size) + (-0.5, size - 0.5)
    index, share = rasterize(np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], -1), size, size)
    covered = index >= 0
    texels = _texels(body, worn, shoe, index[covered], share[covered], seed)
    color = np.zeros((size, size, 3))
    color[covered] = _colors(body, texels)
    # Texels between islands take the nearest colour: filtering must not bleed black.
    nearest = distance_transform_edt(~covered, return_distances=False, return_indices=True)
    return np.clip(color[tuple(nearest)], 0, 255).astype(np.uint8)


def ears_of(body: Body) -> Floats:
    """One at vertices of the ears, (V,)."""
    ears = np.zeros(len(body.vertices))
    value = sample(load_mask("ears"), body.uv[body.face_uv] * (1, -1) + (0, 1))[..., 0] / 255
    ears[body.faces] = np.where((body.island == 1)[:, None], value, 0)
    return ears


def _texels(
    body: Body, worn: Floats, shoe: Floats, face: Integers, share: Floats, seed: int
) -> _Texels:
    def spread(values: Floats, corners: Integers) -> Floats:
        return np.einsum("nk,nkc->nc", share, values[corners[face]])

    source = spread(body.uv, body.face_uv) * (1, -1) + (0, 1)
    head = body.island[face] == 1
    points = Points(
        position=spread(body.vertices, body.faces),
        arm=spread(arm_share(body)[:, None], body.faces)[:, 0],
        head=head,
        ears=np.where(head, sample(load_mask("ears"), source)[:, 0] / 255, 0),
    )
    clothed = replace(points, position=spread(worn, body.faces))
    return _Texels(
        points=points,
        outfit=measure(body, points),
        print_height=measure(body, clothed).above_hem,
        island=body.island[face],
        source=source,
        shoe=spread(shoe, body.faces),
        noise=Noise(seed),
    )


def _colors(body: Body, t: _Texels) -> Floats:
    color = _skin(body, t)
    hairline = t.outfit.hair + 0.003 * t.noise(t.points.position, (0.0022, 0.02, 0.0022))
    color = _blend(color, _hair(t), np.where(t.points.head, _inside(hairline, 0.004), 0))
    is_body = np.isin(t.island, (0, 1))
    ankles = np.isin(t.island, (4, 5))
    color = _blend(color, _CREAM, ankles)
    color = _blend(color, _trousers(body, t), (is_body | ankles) * _inside(t.outfit.trousers))
    color = _blend(color, _shirt(t), is_body * _inside(t.outfit.shirt))
    for island in (6, 7):
        mine = t.island == island
        color[mine] = _eye(body, island, t.points.position[mine])
    color = _blend(color, _shoe(t), t.island >= 8)
    return color


def _inside(distance: Floats, soft: float = _SOFT) -> Floats:
    return np.clip(distance / soft + 0.5, 0, 1)


def _line(distance: Floats, width: float) -> Floats:
    """One on a line of some width about distance zero."""
    return _inside(0.5 * width - np.abs(distance))


def _blend(under: Floats, over: Floats | Color, share: Floats) -> Floats:
    share = np.asarray(share, dtype=np.float64)[:, None]
    return under + share * (np.asarray(over, dtype=np.float64) - under)


def _flat(color: Color, variation: Floats) -> Floats:
    """A colour whose brightness varies by shares such as 0.02, (n, 3)."""
    return np.asarray(color) * (1 + variation[:, None])


def _skin(body: Body, t: _Texels) -> Floats:
    p = t.points.position
    color = _flat(_SKIN, 0.02 * t.noise(p, 0.05) + 0.012 * t.noise(p, 0.004))
    eyes = [body.vertices[np.unique(body.faces[body.island == i])].mean(0) for i in (6, 7)]
    for eye in eyes:  # cheeks, and the tip of the nose between them
        cheek = eye + np.array([np.sign(eye[0]) * 0.010, -0.040, 0.0])
        flush = np.exp(-(((p - cheek)[:, :2] / 0.017) ** 2).sum(1)) * t.points.head
        color = _blend(color, _FLUSH, 0.18 * flush * (p[:, 2] > cheek[2] - 0.03))
    nails = np.where(np.isin(t.island, (2, 3)), sample(load_mask("fingernails"), t.source)[:, 0], 0)
    color = _blend(color, (226, 178, 156), 0.8 * nails / 255)
    lips = np.where(t.points.head, sample(load_mask("lips"), t.source)[:, 0] / 255, 0)
    color = _blend(color, _LIPS, 0.55 * lips)
    color = _eyebrows(color, t, eyes)
    return _openings(body, color, t, eyes)


def _eyebrows(color: Floats, t: _Texels, eyes: list[Floats]) -> Floats:
    """Two arcs over the eyes, fuller at the nose than at the temples."""
    p = t.points.position
    centre = 0.5 * (np.abs(eyes[0]) + np.abs(eyes[1]))
    along = (np.abs(p[:, 0]) - (centre[0] - 0.018)) / 0.040
    height = centre[1] + 0.0165 + 0.006 * np.sin(np.pi * np.clip(0.15 + 0.75 * along, 0, 1))
    half = np.interp(along, [0, 0.15, 0.6, 1], [0.0018, 0.0032, 0.0026, 0.0008])
    strands = 0.0008 * t.noise(p, (0.0012, 0.004, 0.004))
    inside = np.minimum(
        half - np.abs(p[:, 1] - height) + strands, 0.02 * np.minimum(along, 1 - along)
    )
    front = t.points.head & (p[:, 2] > centre[2] - 0.02)
    return _blend(color, _HAIR, 0.85 * front * _inside(inside, 0.0012))


def _openings(body: Body, color: Floats, t: _Texels, eyes: list[Floats]) -> Floats:
    """Lashes along the lids and the line between the lips, where the mesh is open."""
    rim = _open_edges(body)
    distance, nearest = cKDTree(rim).query(t.points.position, distance_upper_bound=0.004)
    nearest = np.minimum(nearest, len(rim) - 1)
    at_eye = np.abs(rim[nearest, 1] - eyes[0][1]) < 0.03
    is_upper = rim[nearest, 1] > eyes[0][1] - 0.001
    lashes = np.where(
        is_upper,
        _inside(0.0018 - distance, 0.0008),
        0.55 * _inside(0.0008 - distance, 0.0008),
    )
    color = _blend(color, _LASHES, np.where(t.points.head & at_eye, lashes, 0))
    slit = np.where(t.points.head & ~at_eye, 0.8 * _inside(0.0010 - distance, 0.0008), 0)
    return _blend(color, (92, 44, 40), slit)


def _open_edges(body: Body) -> Floats:
    """Points along edges of the head that belong to one triangle only, (n, 3)."""
    faces = body.faces[np.isin(body.island, (0, 1, 2, 3, 4, 5))]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    ends = body.vertices[unique[count == 1]]
    ends = ends[ends[:, :, 1].min(1) > body.joint("neck")[1]]
    share = np.linspace(0, 1, 12)[:, None, None]
    return (ends[:, 0] * (1 - share) + ends[:, 1] * share).reshape(-1, 3)


def _hair(t: _Texels) -> Floats:
    p = t.points.position
    strands = t.noise(p, (0.0022, 0.020, 0.0022))
    locks = t.noise(p, (0.012, 0.05, 0.012))
    return _flat(_HAIR, 0.22 * strands + 0.16 * locks)


def _eye(body: Body, island: int, p: Floats) -> Floats:
    """Sclera, iris with a dark rim, pupil and a glint."""
    ball = body.vertices[np.unique(body.faces[body.island == island])]
    centre = 0.5 * (ball.min(0) + ball.max(0))
    direction = (p - centre) / np.linalg.norm(p - centre, axis=1, keepdims=True)
    radius = 0.5 * np.ptp(ball[:, 1])
    off_axis = radius * np.arccos(np.clip(direction[:, 2], -1, 1))
    color = np.tile(np.array([226.0, 220.0, 214.0]), (len(p), 1))
    color = _blend(color, (206, 170, 160), 0.6 * np.clip((off_axis - 0.008) / 0.006, 0, 1))
    color = _blend(color, (46, 28, 18), _inside(0.0062 - off_axis, 0.0006))
    color = _blend(color, (104, 66, 36), _inside(0.0052 - off_axis, 0.0010))
    color = _blend(color, (12, 9, 8), _inside(0.0025 - off_axis, 0.0005))
    glint = np.linalg.norm(direction[:, :2] * radius - (0.0016, 0.0016), axis=1)
    return _blend(color, (250, 250, 250), (direction[:, 2] > 0) * _inside(0.0009 - glint, 0.0005))


def _shirt(t: _Texels) -> Floats:
    """Navy stripes on cream, ribbed collar, plain hems."""
    p = t.points.position
    phase = np.mod(t.print_height, 0.044)
    weave = 0.02 * t.noise(p, 0.0016) + 0.02 * t.noise(p, 0.03)
    color = _flat(_CREAM, weave)
    stripe = _inside(0.0085 - np.abs(phase - 0.034), 0.0024)
    color = _blend(color, _flat(_NAVY, 2 * weave), stripe)
    rib = 0.10 * np.sin(2 * np.pi * np.arctan2(p[:, 0], p[:, 2]) * 60 / np.pi)
    collar = _flat(_NAVY, rib)
    return _blend(color, collar, _is_collar(t) * _inside(0.019 + t.outfit.neck))


def _is_collar(t: _Texels) -> NDArray[np.bool_]:
    return (t.outfit.neck > -0.03) & (t.outfit.sleeve < 0)


def _trousers(body: Body, t: _Texels) -> Floats:
    """Chinos: side seams, back pockets, stitched hems."""
    p = t.points.position
    twill = 0.03 * np.sin((p[:, 1] + p[:, 0] + p[:, 2]) * 2 * np.pi / 0.0045)
    color = _flat(_RUST, twill + 0.03 * t.noise(p, 0.05) + 0.02 * t.noise(p, 0.002))
    stations = [body.joint(f"l_{name}") for name in ("ankle", "knee", "hip")]
    heights = [place[1] for place in stations]
    axis_x = np.interp(p[:, 1], heights, [place[0] for place in stations])
    axis_z = np.interp(p[:, 1], heights, [place[2] for place in stations])
    sideways = np.abs(np.abs(p[:, 0]) - axis_x) > 0.02
    color = _blend(color, _RUST_SEAM, 0.8 * sideways * _line(p[:, 2] - axis_z, 0.0030))
    hem = p[:, 1] - body.joint("l_ankle")[1] - 0.014
    color = _blend(color, _RUST_SEAM, 0.7 * _line(hem, 0.0026))
    crotch = body.joint("l_hip")[1] - 0.07
    across, up = np.abs(np.abs(p[:, 0]) - 0.082) - 0.052, np.abs(p[:, 1] - crotch + 0.005) - 0.050
    pocket = np.maximum(across, up + 0.25 * np.maximum(across + 0.05, 0) * (p[:, 1] < crotch))
    return _blend(color, _RUST_SEAM, 0.7 * (p[:, 2] < axis_z - 0.04) * _line(pocket, 0.0028))


def _shoe(t: _Texels) -> Floats:
    """Canvas sneakers: white sole and toe cap, laces, a stripe along the sole."""
    share, side, height = t.shoe.T
    canvas = 0.03 * np.sin(share * 900) * np.sin(height * 2600)
    color = _flat(_SNEAKER, canvas)
    tongue = (share > 0.42) & (share < 0.70) & (height > 0.05)
    color = _blend(color, (54, 90, 100), tongue * _inside(0.017 - np.abs(side)))
    phase = np.abs(np.mod(share, 0.055) - 0.0275)
    color = _blend(color, _SOLE_WHITE, tongue * _inside(0.020 - np.abs(side)) * (phase < 0.011))
    cap = _inside(share - 0.855 + 12 * side**2, 0.006)
    color = _blend(color, _SOLE_WHITE, cap * (share > 0.6))
    heel = _inside(0.05 - share, 0.006) * (np.abs(side) < 0.02)
    color = _blend(color, _NAVY, heel * (height > 0.03))
    color = _blend(color, _SOLE_WHITE, _inside(0.0245 - height))
    return _blend(color, _NAVY, _line(height - 0.0185, 0.0028) * (share > 0.01))
