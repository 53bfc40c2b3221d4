"""Height and girths of a body in its rest pose, as a tailor takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from perfcap.actor.template import Template
from perfcap.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

ARM_JOINTS = tuple(f"{side}_{part}" for side in "lr" for part in ("shoulder", "elbow", "wrist"))
TAPE_JOINTS = ("l_hip", "r_hip", "l_shoulder", "r_shoulder")
_ARM_SHARE = 0.5  # vertices with more than this weight on arm bones are no trunk
_STEP = 0.005  # metres between the levels that are tried


@dataclass(frozen=True)
class Measurements:
    """Metres. Girths are of the convex outline, as a tape lies.

    Attributes:
        height: from the soles to the crown.
        chest: largest girth of the trunk below the armpits and above the waist.
        waist: smallest girth of the trunk between hips and chest.
        hip: largest girth between crotch and waist.
        inseam: from the crotch to the soles.
    """

    height: float
    chest: float
    waist: float
    hip: float
    inseam: float


@dataclass(frozen=True, eq=False)
class Ring:
    """Where a tape lies around a body: places on edges of its mesh, in order.

    Attributes:
        edges: vertices at both ends of each edge, (N, 2).
        share: of the second end, (N,).
    """

    edges: Integers
    share: Floats

    def on(self, vertices: Floats) -> Floats:
        """The ring on a posed surface (*b, V, 3), (*b, N, 3)."""
        first, second = (vertices[..., self.edges[:, end], :] for end in (0, 1))
        points: Floats = first + self.share[:, None] * (second - first)
        return points


def measure(template: Template) -> Measurements:
    """Measure a body in its rest pose: upright, arms away from the trunk, legs apart.

    Levels are looked for between joints, so any body model with the skeleton's bones serves.

    Raises:
        InputError: a joint is missing, or there is no trunk between hips and shoulders.
    """
    return take(template.vertices, template.faces, *_tape(template), template.name)


def girth_rings(template: Template) -> dict[str, Ring]:
    """Where chest, waist and hip are measured on a body in its rest pose.

    Raises:
        InputError: as ``measure``.
    """
    arm, joints = _tape(template)
    vertices, faces = template.vertices, template.faces
    levels, _, trunk = _levels(vertices, faces, arm, joints, template.name)
    return {name: _ring(vertices, trunk, level) for name, (_, level) in levels.items()}


def _tape(template: Template) -> tuple[NDArray[np.bool_], dict[str, Floats]]:
    """Which vertices are arms, and joints between which levels are looked for."""
    bones = {name: template.bone(name) for name in TAPE_JOINTS}
    joints = {name: template.bone_rest[bone, :3, 3] for name, bone in bones.items()}
    arm = arm_vertices(
        template.bone_names, template.bone_parents, template.weight_bones, template.weights
    )
    return arm, joints


def _ring(vertices: Floats, faces: Integers, level: float) -> Ring:
    """The convex outline of the section by the plane y = level."""
    edges, share = _crossings(vertices, faces, level)
    outline = ConvexHull(Ring(edges, share).on(vertices)[:, [0, 2]]).vertices
    return Ring(edges[outline], share[outline])


def take(
    vertices: Floats,
    faces: Integers,
    arm: NDArray[np.bool_],
    joints: Mapping[str, Floats],
    name: str = "body",
) -> Measurements:
    """Measure a surface (V, 3).

    Args:
        vertices: rest pose, metres, y up.
        faces: (T, 3).
        arm: which vertices are arms, (V,).
        joints: rest positions of ``TAPE_JOINTS``, (3,) each.
        name: for messages.
    """
    floor, top = vertices[:, 1].min(), vertices[:, 1].max()
    levels, crotch, _ = _levels(vertices, faces, arm, joints, name)
    girths = {part: size for part, (size, _) in levels.items()}
    return Measurements(height=float(top - floor), inseam=float(crotch - floor), **girths)


def _levels(
    vertices: Floats,
    faces: Integers,
    arm: NDArray[np.bool_],
    joints: Mapping[str, Floats],
    name: str,
) -> tuple[dict[str, tuple[float, float]], float, Integers]:
    """Girths with their levels, that of the crotch, and the faces of the trunk."""
    hips = 0.5 * (joints["l_hip"] + joints["r_hip"])
    shoulders = 0.5 * (joints["l_shoulder"] + joints["r_shoulder"])
    trunk = faces[~arm[faces].any(1)]
    crotch = _crotch(vertices, trunk, float(hips[0]), float(hips[1]))
    length = float(shoulders[1] - hips[1])
    girths = _Girths(vertices, trunk, name)
    chest_from, chest_to = hips[1] + 0.55 * length, hips[1] + 0.80 * length
    waist = girths.least(hips[1] + 0.15 * length, chest_from)
    chest = girths.largest(chest_from, chest_to)
    hip = girths.largest(crotch + 0.01, waist[1])
    return {"chest": chest, "waist": waist, "hip": hip}, crotch, trunk


def girth(vertices: Floats, faces: Integers, level: float) -> float:
    """Perimeter of the convex outline of a mesh's section by the plane y = level, metres.

    Args:
        vertices: (V, 3).
        faces: triangles that count, (T, 3); leave out the arms for a trunk.
        level: metres.

    Returns:
        0 where the plane meets nothing.
    """
    points = section(vertices, faces, level)[:, [0, 2]]
    if len(points) < 3:
        return 0.0
    try:
        hull = ConvexHull(points)
    except QhullError:  # all on a line
        return 0.0
    return float(hull.area)  # of a plane figure this is the perimeter


def section(vertices: Floats, faces: Integers, level: float) -> Floats:
    """Points in which the edges of triangles cross the plane y = level, (P, 3)."""
    return Ring(*_crossings(vertices, faces, level)).on(vertices)


def _crossings(vertices: Floats, faces: Integers, level: float) -> tuple[Integers, Floats]:
    """Edges (P, 2) that cross the plane y = level, and where, as shares of the second end."""
    height = vertices[:, 1] - level
    above = height >= 0
    corners = above[faces[:, 0]], above[faces[:, 1]], above[faces[:, 2]]
    found = []
    for one, other in ((0, 1), (1, 2), (2, 0)):
        across = np.flatnonzero(corners[one] != corners[other])
        found.append(faces[across][:, [one, other]])
    edges = np.concatenate(found)
    first, second = height[edges].T
    return edges, first / (first - second)


class _Girths:
    """Girths of the trunk at levels from one to another."""

    def __init__(self, vertices: Floats, faces: Integers, name: str) -> None:
        self.vertices, self.faces, self.name = vertices, faces, name

    def largest(self, low: float, high: float) -> tuple[float, float]:
        """Girth and its level."""
        return max(self._all(low, high))

    def least(self, low: float, high: float) -> tuple[float, float]:
        """Girth and its level."""
        return min(self._all(low, high))

    def _all(self, low: float, high: float) -> list[tuple[float, float]]:
        levels = np.arange(low, max(high, low + _STEP / 2), _STEP)
        heights = self.vertices[self.faces, 1]
        here = self.faces[(heights.max(1) >= low) & (heights.min(1) <= levels[-1])]
        found = [(girth(self.vertices, here, float(y)), float(y)) for y in levels]
        found = [pair for pair in found if pair[0] > 0]
        if not found:
            raise InputError(
                f"body {self.name!r} has no surface between {low:.2f} and {high:.2f} m, where its "
                "trunk should be; measure a body in its rest pose, upright along y"
            )
        return found


def _crotch(vertices: Floats, faces: Integers, middle: float, hips: float) -> float:
    """Lowest point of the trunk in the plane between the legs."""
    swapped = vertices[:, [1, 0, 2]]  # section() cuts the second axis
    heights = section(swapped, faces, middle)[:, 0]
    below = heights[heights < hips]
    if not len(below):
        raise InputError("body has no crotch below its hips; measure it with the legs apart")
    return float(below.min())


def arm_vertices(
    names: Sequence[str], parents: Integers, weight_bones: Integers, weights: Floats
) -> NDArray[np.bool_]:
    """Vertices that move mostly with the arms, (V,); bones below the elbow may have any name."""
    owner: list[bool] = []
    for name, parent in zip(names, parents, strict=True):
        owner.append(name in ARM_JOINTS or (parent >= 0 and owner[parent]))
    share = (weights * np.array(owner)[weight_bones]).sum(1)
    arm: NDArray[np.bool_] = share > _ARM_SHARE
    return arm
