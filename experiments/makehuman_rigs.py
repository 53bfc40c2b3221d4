"""The rigs of the MakeHuman assets as skinned templates, built from their own files.

A bone begins and ends at the mean of a few vertices of the base mesh, so it follows any body shape.
Its axes are built like Blender's: y along the bone.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import Template, strongest_influences

Floats = NDArray[np.float64]

_DECIMETRE = 0.1
_BODY = 13380  # vertices of the body; joint markers and helpers follow


def rigs(folder: Path) -> dict[str, tuple[Path, Path | None]]:
    """Files of skeleton and weights by name; None where the weights were not published along."""
    rig = folder / "rig"
    return {
        "default": (rig / "default.mhskel", rig / "default_weights.mhw"),
        "cmu_mb (json)": (rig / "rig.cmu_mb.json", rig / "weights.cmu_mb.json"),
        "cmu_mb (mhskel)": (rig / "cmu_mb.mhskel", rig / "weights.cmu_mb.json"),
        "openpose": (rig / "rig.openpose.json", None),
    }


def build(folder: Path, skeleton: Path, weights: Path, name: str = "makehuman") -> Template:
    """The body of the base mesh, in metres, on one of its rigs."""
    points, faces, uv = _base(folder / "base" / "base.obj")
    groups = json.loads((folder / "base" / "basemesh_vertex_groups.json").read_text())
    cubes = {group: slice(spans[0][0], spans[0][1] + 1) for group, spans in groups.items()}
    bones = _bones(json.loads(skeleton.read_text()), points, cubes)
    order = _parents_first({bone: parent for bone, (parent, _, _) in bones.items()})
    rest = np.stack([_frame(bones[bone][1], bones[bone][2]) for bone in order])
    shares = json.loads(weights.read_text())["weights"]
    weight_bones, values = _skin(shares, order)
    split = _split(faces, uv)
    lift = np.array([0.0, -points[:_BODY, 1].min(), 0.0])  # the origin is inside the body
    rest[:, :3, 3] += lift
    return Template(
        vertices=points[split["vertex"]] + lift,
        faces=split["faces"],
        bone_names=tuple(order),
        bone_parents=np.array([order.index(p) if (p := bones[b][0]) else -1 for b in order]),
        bone_rest=rest,
        weight_bones=weight_bones[split["vertex"]],
        weights=values[split["vertex"]],
        uv=split["uv"],
        name=name,
    )


def _base(path: Path) -> tuple[Floats, NDArray[np.int64], Floats]:
    """All vertices in metres, and triangles (T, 3, 2) of vertex and texture coordinate."""
    points, coordinates, corners, group = [], [], [], ""
    for line in path.read_text().splitlines():
        kind, *rest = line.split() or [""]
        if kind == "v":
            points.append([float(v) for v in rest])
        elif kind == "vt":
            coordinates.append([float(v) for v in rest[:2]])
        elif kind == "g":
            group = rest[0]
        elif kind == "f" and group == "body":
            quad = [[int(v) - 1 for v in corner.split("/")[:2]] for corner in rest]
            corners += [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]
    uv = np.array(coordinates)
    uv[:, 1] = 1 - uv[:, 1]
    return np.array(points) * _DECIMETRE, np.array(corners), uv


def _split(corners: NDArray[np.int64], uv: Floats) -> dict[str, NDArray[Any]]:
    """One vertex for each pair of place and texture coordinate."""
    pairs, inverse = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    return {
        "vertex": pairs[:, 0],
        "faces": inverse.reshape(-1, 3),
        "uv": uv[pairs[:, 1]],
    }


def _bones(
    tree: Mapping[str, Any], points: Floats, cubes: Mapping[str, slice]
) -> dict[str, tuple[str, Floats, Floats]]:
    """Parent, head and tail of each bone by name, from either format of the assets."""
    entries = tree.get("bones", tree)
    if "joints" in tree and isinstance(next(iter(entries.values()))["head"], str):
        return {
            name: (
                bone["parent"] or "",
                points[tree["joints"][bone["head"]]].mean(0),
                points[tree["joints"][bone["tail"]]].mean(0),
            )
            for name, bone in entries.items()
        }
    return {
        name: (
            bone["parent"] or "",
            _place(bone["head"], points, cubes),
            _place(bone["tail"], points, cubes),
        )
        for name, bone in entries.items()
    }


def _place(end: Mapping[str, Any], points: Floats, cubes: Mapping[str, slice]) -> Floats:
    if end["strategy"] == "CUBE" and end["cube_name"] in cubes:
        return np.asarray(points[cubes[end["cube_name"]]].mean(0))
    if end["strategy"] == "MEAN":
        return np.asarray(points[end["vertex_indices"]].mean(0))
    if end["strategy"] == "VERTEX":
        return np.asarray(points[end["vertex_index"]])
    x, y, z = end["default_position"]  # z up
    return np.array([x, z, -y])


def _parents_first(parents: Mapping[str, str]) -> list[str]:
    order: list[str] = []
    while len(order) < len(parents):
        order += [b for b, p in parents.items() if b not in order and (not p or p in order)]
    return order


def _skin(
    shares: Mapping[str, list[list[float]]], order: list[str]
) -> tuple[NDArray[np.int64], Floats]:
    """The four heaviest bones of each vertex of the body; sums in the files are only about one."""
    dense = np.zeros((_BODY, len(order)))
    for bone, entries in shares.items():
        for vertex, weight in entries:
            if vertex < _BODY:
                dense[int(vertex), order.index(bone)] += weight
    every = np.tile(np.arange(len(order)), (_BODY, 1))
    heaviest = np.argsort(-dense, axis=1)[:, :8]
    return strongest_influences(
        np.take_along_axis(every, heaviest, 1), np.take_along_axis(dense, heaviest, 1)
    )


def _frame(head: Floats, tail: Floats) -> Floats:
    along = tail - head
    length = np.linalg.norm(along)
    along = along / length if length > 1e-9 else np.array([0.0, 1.0, 0.0])
    side = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    frame = np.eye(4)
    frame[:3, :3] = np.stack((side, along, np.cross(side, along)), 1)
    frame[:3, 3] = head
    return frame
