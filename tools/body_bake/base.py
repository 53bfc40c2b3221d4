"""The MakeHuman base mesh before any morph, and what of it is a visible body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from actor_bake.assets import (
    NAMES,
    Body,
    asset_root,
    joint_positions,
    merged_weights,
    read_obj,
    visible_faces,
)
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_METRES = 0.1  # the assets are in decimetres


@dataclass(frozen=True, eq=False)
class Base:
    """Mesh with helpers: joint cubes, eyes, clothes proxies."""

    vertices: Floats  # (V, 3) m
    uv: Floats  # (N, 2), origin at the bottom left
    groups: dict[str, Integers]  # quads (Q, 4, 2) of (vertex, texture corner)
    body: Integers  # vertices of the skin

    def joints(self, person: Floats) -> Floats:
        """Joints of ``NAMES`` on a morphed copy of the vertices, (J, 3)."""
        return joint_positions(person, self.groups)


def load_base() -> Base:
    """The base mesh, in metres."""
    vertices, uv, groups = read_obj(asset_root() / "3dobjs/base.obj")
    return Base(vertices * _METRES, uv, groups, np.unique(groups["body"][..., 0]))


def visible_body(base: Base, person: Floats) -> tuple[Body, Integers]:
    """A morphed person without cavities and helpers, and which vertices were kept, (U,)."""
    faces, face_uv, island = visible_faces(person, base.uv, base.groups)
    path = asset_root() / "rigs/standard/weights.cmu_mb.json"
    weights = merged_weights(path, len(person))
    for group in ("helper-l-eye", "helper-r-eye"):
        weights[np.unique(base.groups[group][..., 0])] = np.eye(len(NAMES))[NAMES.index("head")]
    used, compact = np.unique(faces, return_inverse=True)
    body = Body(
        vertices=person[used],
        bare=person[used],
        faces=compact.reshape(-1, 3),
        face_uv=face_uv,
        uv=base.uv,
        island=island,
        weights=weights[used],
        joints=base.joints(person),
    )
    return body, used
