"""Primitives of a glTF file that hang on a skeleton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from perfcap.geometry.surface_topology import surface_topology
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.gltf_document import Document, Object
from perfcap.io.gltf_scene import NodeTree, Skin, drawn_nodes, read_skin, rigid
from perfcap.io.gltf_shape_keys import ShapeKeys, default_weights
from perfcap.io.gltf_texture import Blend, Material, read_blend, read_material
from perfcap.io.texture_tiles import repeating

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_TRIANGLES = 4
_MAX_VERTICES = 4_000_000
_NO_WEIGHT = 1e-6
_MOST_BARE, _FEW_BARE = 0.05, 50  # share and number of vertices; more are a forgotten part
_ROUGH_SUM = 0.01  # what weights of 8 bits are off by


@dataclass(frozen=True, eq=False)
class Part:
    """One primitive: world vertices in the rest pose, and skinning by node index."""

    name: str
    vertices: Floats
    faces: Integers
    nodes: Integers  # (v, K)
    weights: Floats  # (v, K), rows sum to one
    uv: Floats | None
    material: Material
    blend: Blend | None = None


class _Triangles(NamedTuple):
    """A primitive as the file has it, with the name of its mesh."""

    name: str
    primitive: Object
    attributes: Object
    shape: object  # default weights of its morph targets


def read_parts(
    document: Document, tree: NodeTree, notes: list[Finding]
) -> tuple[list[Part], list[Skin]]:
    """All that the file's skeletons move, and the skins that do it.

    Args:
        document: the file.
        tree: its nodes.
        notes: where to say what is odd.
    """
    keys = ShapeKeys(document)
    skins: dict[int, Skin] = {}
    parts: list[Part] = []
    unskinned: list[int] = []
    for place, node in _with_meshes(document, tree, notes):
        if "skin" not in node:
            unskinned.append(place)
            continue
        number = document.integer(node["skin"], "node.skin")
        if number not in skins:
            skins[number] = read_skin(document, document.item("skins", number), tree, notes)
        parts += _read_mesh(keys, node, skins[number], notes)
    used = list(skins.values())
    for place in unskinned if parts else []:
        parts += _read_loose(keys, tree, place, used, parts, notes)
    return parts, used


def read_unskinned(document: Document, tree: NodeTree, notes: list[Finding]) -> list[Part]:
    """All meshes that a file shows, where its nodes put them, without weights; see `read_parts`."""
    keys = ShapeKeys(document)
    return [
        _read_primitive(keys, triangles, tree.world[place])
        for place, node in _with_meshes(document, tree, notes)
        for triangles in _primitives(document, node)
    ]


def _with_meshes(
    document: Document, tree: NodeTree, notes: list[Finding]
) -> list[tuple[int, Object]]:
    """Nodes with meshes, by number, without those that programs do not draw beside others."""
    every = [(k, node) for k, node in enumerate(document.items("nodes")) if "mesh" in node]
    drawn = drawn_nodes(document, tree)
    shown = [(place, node) for place, node in every if drawn[place]]
    if not shown:
        return every
    for place, node in every:
        if not drawn[place]:
            what = "is hidden, or in another scene of the file, and is left out"
            remedy = "show it in the program that wrote the file if it belongs to the person"
            notes.append(Finding(Severity.WARNING, str(node.get("name", place)), what, remedy))
    return shown


def joined(parts: Sequence[Part]) -> tuple[Floats, Integers]:
    """Vertices and faces of all parts as one mesh."""
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=False)]
    return np.concatenate([part.vertices for part in parts]), np.concatenate(faces)


def joined_uv(parts: Sequence[Part], coordinates: Sequence[Floats | None]) -> Floats | None:
    """Texture coordinates of all parts, zero where a part has none; None if none has."""
    if all(uv is None for uv in coordinates):
        return None
    return np.concatenate(
        [
            np.broadcast_to(np.zeros((1, 2)) if uv is None else uv, (len(part.vertices), 2))
            for part, uv in zip(parts, coordinates, strict=True)
        ]
    )


def _read_mesh(keys: ShapeKeys, node: Object, skin: Skin, notes: list[Finding]) -> list[Part]:
    parts = []
    for triangles in _primitives(keys.document, node):
        attributes = triangles.attributes
        if "JOINTS_0" not in attributes:
            what = "a primitive without weights is left out"
            notes.append(Finding(Severity.ERROR, triangles.name, what, "bind it to the skeleton"))
            continue
        part = _read_primitive(keys, triangles, skin.bind_to_world)
        slot, weight = _read_weights(keys.document, attributes, skin, len(part.vertices))
        part = replace(part, nodes=np.array(skin.joints)[slot], weights=weight)
        parts.append(_normalized(part, notes))
    return parts


def _read_loose(
    keys: ShapeKeys,
    tree: NodeTree,
    place: int,
    skins: list[Skin],
    others: list[Part],
    notes: list[Finding],
) -> list[Part]:
    """A mesh without a skin: carried by the bone above it, else no part of the person."""
    rest = {n: r for skin in skins for n, r in zip(skin.joints, skin.rest, strict=True)}
    bone = place
    while bone >= 0 and bone not in rest:
        bone = int(tree.parents[bone])
    moved = np.eye(4) if bone < 0 else rest[bone] @ np.linalg.inv(rigid(tree.world[[bone]])[0])
    parts = []
    for triangles in _primitives(keys.document, keys.document.items("nodes")[place]):
        part = _read_primitive(keys, triangles, moved @ tree.world[place])
        if bone >= 0:
            count = len(part.vertices)
            part = replace(part, nodes=np.full((count, 1), bone), weights=np.ones((count, 1)))
            parts.append(part)
        elif _amid(part, others):
            what = "has no weights, though it is where the body is"
            remedy = "bind it to the skeleton, or delete it"
            notes.append(Finding(Severity.ERROR, part.name, what, remedy))
        else:
            what = "hangs on no bone and is left out"
            notes.append(Finding(Severity.WARNING, part.name, what, "delete it from the file"))
    return parts


def _amid(part: Part, others: list[Part]) -> bool:
    """Whether the middle of a part is within the box around the others."""
    middle = 0.5 * (part.vertices.min(0) + part.vertices.max(0))
    low = np.min([other.vertices.min(0) for other in others], axis=0)
    high = np.max([other.vertices.max(0) for other in others], axis=0)
    size = np.linalg.norm(np.ptp(part.vertices, axis=0)) / np.linalg.norm(high - low)
    return bool(np.all(middle > low) and np.all(middle < high) and size < 1.5)


def _primitives(document: Document, node: Object) -> list[_Triangles]:
    """Each set of triangles of the mesh of a node."""
    number = node["mesh"]
    mesh = document.item("meshes", number)
    primitives = mesh.get("primitives")
    given = mesh.get("name")
    name = given if isinstance(given, str) and given else f"mesh {number}"
    shape = default_weights(node, mesh)
    found = []
    for primitive in primitives if isinstance(primitives, list) else []:
        attributes = primitive.get("attributes") if isinstance(primitive, dict) else None
        if not isinstance(attributes, dict):
            raise document.error("damaged file, a primitive has no attributes")
        if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
            raise document.error("holds strips, lines or points; export plain triangles")
        found.append(_Triangles(name, primitive, attributes, shape))
    return found


def _read_primitive(keys: ShapeKeys, triangles: _Triangles, to_world: Floats) -> Part:
    """A primitive in the world, without weights."""
    document, (name, primitive, attributes, shape) = keys.document, triangles
    local = _floats(document, attributes.get("POSITION"), "VEC3")
    if len(local) > _MAX_VERTICES:
        raise document.error(f"{len(local)} vertices; at most {_MAX_VERTICES} are read")
    local = keys.applied(local, primitive, shape)
    linear, offset = to_world[:3, :3], to_world[:3, 3]
    material, coordinate, transform, axes = read_material(document, primitive)
    uv = None
    if f"TEXCOORD_{coordinate}" in attributes:
        uv = _floats(document, attributes[f"TEXCOORD_{coordinate}"], "VEC2", len(local))
        uv = repeating(uv @ transform[:, :2].T + transform[:, 2], axes)
    faces = _read_faces(document, primitive, len(local))
    if np.linalg.det(linear) < 0:
        faces = faces[:, ::-1]  # a mirrored armature turns triangles inside out
    none = np.zeros((len(local), 0))
    vertices = local @ linear.T + offset
    blend = read_blend(document, primitive)
    return Part(name, vertices, faces, none.astype(np.int64), none, uv, material, blend)


def _read_faces(document: Document, primitive: Object, vertices: int) -> Integers:
    if "indices" in primitive:
        indices = document.accessor(primitive["indices"], "SCALAR")[:, 0]
        if indices.dtype.kind != "u" or indices.max() >= vertices:
            raise document.error(f"triangle indices {indices.max()} of {vertices} vertices")
    else:
        indices = np.arange(vertices)
    if len(indices) % 3:
        raise document.error(f"{len(indices)} triangle indices, not a multiple of 3")
    return indices.astype(np.int64).reshape(-1, 3)


def _read_weights(
    document: Document, attributes: Object, skin: Skin, vertices: int
) -> tuple[Integers, Floats]:
    """Joints by their place in the skin, and weights as the file has them, (v, 4 or more)."""
    slots, weights = [], []
    for group in range(4):
        if f"JOINTS_{group}" not in attributes:
            break
        slots.append(_attribute(document, attributes[f"JOINTS_{group}"], "VEC4", vertices))
        weights.append(_floats(document, attributes.get(f"WEIGHTS_{group}"), "VEC4", vertices))
    slot, weight = np.concatenate(slots, axis=1), np.concatenate(weights, axis=1)
    weight = np.maximum(weight, 0.0)
    slot = np.where(weight > 0, slot, 0)
    if slot.dtype.kind not in "iu" or slot.max() >= len(skin.joints):
        raise document.error(
            f"weights name joint {slot.max()}, but the skin has {len(skin.joints)}; export it again"
        )
    return slot, weight


def _normalized(part: Part, notes: list[Finding]) -> Part:
    """The part with weights that sum to one; bare vertices follow the nearest that have some."""
    total = part.weights.sum(1)
    bare = total < _NO_WEIGHT
    rough = ~bare & (np.abs(total - 1) > _ROUGH_SUM)
    if rough.any():
        sums = total[rough]
        what = f"weights of {len(sums)} vertices sum to {sums.min():.3f} to {sums.max():.3f}"
        notes.append(Finding(Severity.WARNING, part.name, what, "they were scaled to one"))
    weights = part.weights / np.where(bare, 1.0, total)[:, None]
    nodes = part.nodes.copy()
    if bare.any():
        pieces = _bare_pieces(part, bare)
        wrong = bool(pieces) or int(bare.sum()) > max(_FEW_BARE, _MOST_BARE * len(bare))
        severity = Severity.ERROR if wrong else Severity.WARNING
        whole = f", among them {pieces} whole pieces" if pieces else ""
        what = f"{int(bare.sum())} vertices without weights{whole}"
        remedy = "paint them" if wrong else "they follow their neighbours"
        notes.append(Finding(severity, part.name, what, remedy))
        weights[bare, 0] = 1.0
    if bare.any() and not bare.all():
        _, nearest = KDTree(part.vertices[~bare]).query(part.vertices[bare])
        nodes[bare], weights[bare] = nodes[~bare][nearest], weights[~bare][nearest]
    return replace(part, nodes=nodes, weights=weights)


def _bare_pieces(part: Part, bare: NDArray[np.bool_]) -> int:
    """Connected pieces of which no vertex has a weight."""
    topology = surface_topology(part.vertices, part.faces)
    component = topology.component[topology.place]
    used = component >= 0
    covered = np.unique(component[used & ~bare])
    return len(np.setdiff1d(component[used & bare], covered))


def _floats(document: Document, index: object, kind: str, count: int | None = None) -> Floats:
    with np.errstate(invalid="ignore"):  # damaged numbers; what is not finite is refused below
        values = _attribute(document, index, kind, count).astype(np.float64)
    if not np.isfinite(values).all():
        raise document.error(f"accessor {index} holds NaN or infinity; export it again")
    return values


def _attribute(document: Document, index: object, kind: str, count: int | None) -> NDArray[Any]:
    values = document.accessor(index, kind)
    if count is not None and len(values) != count:
        raise document.error(f"accessor {index} has {len(values)} rows for {count} vertices")
    return values
