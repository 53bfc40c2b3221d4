"""Clothes and hair as displacements of the body surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from actor_bake.assets import NAMES, Body
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import PchipInterpolator

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SOLE = 0.018  # metres the person stands above the ground in shoes
_ARM = ("shoulder", "elbow", "wrist")
# Azimuth from the face in degrees, and height of the hairline above the eyes in metres.
_HAIRLINE = (
    [0, 25, 42, 55, 66, 80, 98, 112, 130, 180],
    [0.078, 0.076, 0.064, 0.030, -0.004, -0.012, 0.020, -0.030, -0.058, -0.066],
)


@dataclass(frozen=True, eq=False)
class Points:
    """Points of the bare body surface, (n, ...): vertices, or the texels of the texture."""

    position: Floats  # (n, 3) m
    arm: Floats  # share of skinning weight on arm bones, (n,)
    head: NDArray[np.bool_]  # on the head, (n,)
    ears: Floats  # one on the ears, (n,)


@dataclass(frozen=True, eq=False)
class Outfit:
    """Garments as signed distances in metres, positive inside, (n,) each."""

    shirt: Floats
    above_hem: Floats  # metres from the hem of the shirt, or of its sleeve
    trousers: Floats
    hair: Floats
    sleeve: Floats  # metres along the upper arm from the shoulder joint, -1 off the arms
    neck: Floats  # distance into the opening of the collar


def arm_share(body: Body) -> Floats:
    """Weight of arm bones at each vertex, (V,)."""
    columns = [NAMES.index(f"{side}_{part}") for side in "lr" for part in _ARM]
    share: Floats = body.weights[:, columns].sum(1)
    return share


def measure(body: Body, points: Points) -> Outfit:
    """Where points lie relative to the hems and hairline of a bare body."""
    p = points.position
    sleeve = _arm_coordinate(body, points)
    upper = 0.60 * np.linalg.norm(body.joint("l_elbow") - body.joint("l_shoulder"))
    neck = _inside_neckline(body, p)
    hem = body.joint("l_hip")[1] - 0.035
    above_hem = np.where(sleeve > 0, upper - sleeve, p[:, 1] - hem)
    shirt = np.where(sleeve > 0, above_hem, np.minimum(above_hem, -neck))
    ankle = body.joint("l_ankle")[1]
    trousers = np.minimum(hem + 0.06 - p[:, 1], p[:, 1] - ankle + 0.009)
    return Outfit(
        shirt=np.where(points.head, np.minimum(shirt, -neck), shirt),
        above_hem=above_hem,
        trousers=np.where(points.arm > 0.5, -1.0, trousers),
        hair=_above_hairline(body, points),
        sleeve=sleeve,
        neck=neck,
    )


def _inside_neckline(body: Body, p: Floats) -> Floats:
    """Distance into the opening of the collar: a cone about the neck that dips in front."""
    from_neck = p - body.joint("neck")
    rise = from_neck[:, 1] + 0.022 + 0.45 * from_neck[:, 2]
    around = np.hypot(0.85 * from_neck[:, 0], from_neck[:, 2])
    inside: Floats = 0.6 * rise + 0.8 * (0.072 - around)
    return inside


def _arm_coordinate(body: Body, points: Points) -> Floats:
    """Metres along the upper arm beyond the armhole, -1 elsewhere."""
    sleeve = np.full(len(points.position), -1.0)
    for side, sign in (("l", 1), ("r", -1)):
        start, end = body.joint(f"{side}_shoulder"), body.joint(f"{side}_elbow")
        along = (points.position - start) @ (end - start) / np.linalg.norm(end - start)
        member = (points.arm > 0.5) & (along > 0.02) & (sign * points.position[:, 0] > 0)
        sleeve[member] = along[member]
    return sleeve


def _above_hairline(body: Body, points: Points) -> Floats:
    """Height above the hairline on the head, -1 elsewhere."""
    p = points.position
    eyes = body.vertices[np.unique(body.faces[np.isin(body.island, (6, 7))])].mean(0)
    azimuth = np.degrees(np.arctan2(np.abs(p[:, 0]), p[:, 2] - body.joint("head")[2] - 0.005))
    above = p[:, 1] - eyes[1] - PchipInterpolator(*_HAIRLINE)(azimuth)
    return np.where(points.head & (points.ears < 0.4), above, -1.0)


def dress(body: Body, outfit: Outfit) -> Body:
    """The body in clothes: smoothed under cloth, pushed out, combed, lifted onto its soles."""
    average = _averaging(body)
    cover = np.clip(np.maximum(outfit.shirt, outfit.trousers) / 0.015, 0, 1)
    torso = np.clip(outfit.shirt / 0.03, 0, 1) * np.clip(1 - 2 * arm_share(body), 0, 1)
    vertices = _smooth(body.vertices, body.faces, average, 0.6 * cover, steps=12)
    vertices = _smooth(vertices, body.faces, average, 0.6 * torso, steps=40)
    normals = vertex_normals(vertices, body.faces)
    push = _cloth_thickness(body, outfit) + _hair_thickness(outfit)
    push = _smooth_scalar(push, average, steps=1)
    vertices = vertices + push[:, None] * normals
    lift = np.array([0.0, SOLE, 0.0])
    return replace(body, vertices=vertices + lift, joints=body.joints + lift)


def _step(value: Floats, width: float) -> Floats:
    share = np.clip(value / width, 0, 1)
    return share * share * (3 - 2 * share)


def _cloth_thickness(body: Body, outfit: Outfit) -> Floats:
    """Metres the cloth stands off the skin; hems stand off more than the rest."""
    loose = 0.012 + 0.008 * _step(0.45 - outfit.shirt, 0.35)
    shirt = np.where(outfit.sleeve > 0, 0.010 + 0.05 * outfit.sleeve, loose)
    shirt = np.where(outfit.neck > -0.025, 0.006, shirt)
    near_hem = np.exp(-np.maximum(outfit.shirt, 0) / 0.10) * (outfit.sleeve < 0)
    shirt = shirt + 0.006 * near_hem * (outfit.neck < -0.2)
    knee, ankle = body.joint("l_knee")[1], body.joint("l_ankle")[1]
    lower = np.clip((knee - body.vertices[:, 1]) / (knee - ankle), 0, 1)
    trousers = 0.008 + 0.012 * lower
    on_shirt = _step(outfit.shirt + 0.004, 0.008)
    on_trousers = _step(outfit.trousers + 0.006, 0.008)
    return np.maximum(on_shirt * shirt, on_trousers * trousers * (outfit.shirt < 0.012))


def _hair_thickness(outfit: Outfit) -> Floats:
    return 0.006 * _step(outfit.hair, 0.01) + 0.016 * _step(outfit.hair - 0.01, 0.07)


def vertex_normals(vertices: Floats, faces: Integers) -> Floats:
    """Area-weighted unit normals, (V, 3)."""
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    np.add.at(normals, faces, area[:, None])
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _averaging(body: Body) -> sparse.csr_matrix:
    """Matrix that replaces each vertex by the mean of its neighbours."""
    edges = np.concatenate([body.faces[:, [0, 1]], body.faces[:, [1, 2]], body.faces[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    count = len(body.vertices)
    adjacency = sparse.coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count)).tocsr()
    adjacency.data[:] = 1
    return sparse.diags(1 / np.maximum(adjacency.sum(1).A1, 1)) @ adjacency


def _smooth(
    vertices: Floats, faces: Integers, average: sparse.csr_matrix, amount: Floats, steps: int
) -> Floats:
    """Level bumps along the normals only: sideways motion would warp the printed pattern."""
    for _ in range(steps):
        normals = vertex_normals(vertices, faces)
        rise = ((average @ vertices - vertices) * normals).sum(1)
        vertices = vertices + (amount * rise)[:, None] * normals
    return vertices


def _smooth_scalar(values: Floats, average: sparse.csr_matrix, steps: int) -> Floats:
    for _ in range(steps):
        values = 0.5 * values + 0.5 * (average @ values)
    return values
