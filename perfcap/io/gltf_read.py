"""Read a rigged character from a skinned glTF 2.0 file."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import Template, image_mime
from perfcap.errors import InputError
from perfcap.io.gltf_document import Document, Object, open_document
from perfcap.io.gltf_scene import NodeTree, Skin, read_skin, read_tree

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_LOG = logging.getLogger(__name__)
_TRIANGLES = 4
_MAX_VERTICES = 4_000_000


@dataclass(frozen=True, eq=False)
class _Part:
    """One primitive: world vertices, and skinning by node index."""

    vertices: Floats
    faces: Integers
    nodes: Integers  # (v, K)
    weights: Floats  # (v, K)
    uv: Floats | None
    image: object  # index of the base colour image, or None


def load_template(path: str | Path) -> Template:
    """Load the skinned mesh of a ``.glb`` or ``.gltf`` as a `Template`.

    The inverse bind matrices decide the rest pose; the nodes place it in the world, so scaled or
    turned armatures come out in metres, y up. All primitives of all skinned meshes are merged.
    Joints without weights are kept as bones: they mark places such as the top of the head.

    Raises:
        InputError: the file is missing, damaged, compressed, or has no skinned mesh.
    """
    return read_template(open_document(Path(path)))


def read_template(document: Document) -> Template:
    """Like ``load_template``, of a file that is already open."""
    tree = read_tree(document)
    skins: dict[int, Skin] = {}
    parts: list[_Part] = []
    for node in document.items("nodes"):
        if "mesh" not in node or "skin" not in node:
            continue
        number = document.integer(node["skin"], "node.skin")
        if number not in skins:
            skins[number] = read_skin(document, document.item("skins", number), tree)
        parts += _read_mesh(document, document.item("meshes", node["mesh"]), skins[number])
    if not parts:
        raise document.error(
            "has no skinned mesh; bind the mesh to a skeleton, or use `perfcap actor build`"
        )
    return _assemble(document, tree, list(skins.values()), parts)


def _read_mesh(document: Document, mesh: Object, skin: Skin) -> list[_Part]:
    primitives = mesh.get("primitives")
    parts = []
    for primitive in primitives if isinstance(primitives, list) else []:
        attributes = primitive.get("attributes") if isinstance(primitive, dict) else None
        if not isinstance(attributes, dict):
            raise document.error("damaged file, a primitive has no attributes")
        if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
            raise document.error("holds strips, lines or points; export plain triangles")
        if "JOINTS_0" in attributes:
            parts.append(_read_primitive(document, primitive, attributes, skin))
        else:
            _LOG.warning("%s: a primitive without weights is left out", document.path)
    return parts


def _read_primitive(document: Document, primitive: Object, attributes: Object, skin: Skin) -> _Part:
    local = _floats(document, attributes.get("POSITION"), "VEC3")
    if len(local) > _MAX_VERTICES:
        raise document.error(f"{len(local)} vertices; at most {_MAX_VERTICES} are read")
    linear, offset = skin.bind_to_world[:3, :3], skin.bind_to_world[:3, 3]
    nodes, weights = _read_weights(document, attributes, skin, len(local))
    coordinate, image = _base_color(document, primitive)
    uv = None
    if f"TEXCOORD_{coordinate}" in attributes:
        uv = _floats(document, attributes[f"TEXCOORD_{coordinate}"], "VEC2", len(local))
    faces = _read_faces(document, primitive, len(local))
    if np.linalg.det(linear) < 0:
        faces = faces[:, ::-1]  # a mirrored armature turns triangles inside out
    return _Part(local @ linear.T + offset, faces, nodes, weights, uv, image)


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
    """Node indices and weights of a primitive, (v, 4 or more), rows summing to one."""
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
        raise document.error(f"weights name joint {slot.max()} of {len(skin.joints)}")
    total = weight.sum(1)
    if np.any(total < 1e-6):
        _LOG.warning("%s: %d vertices without weights follow the first joint of the skin",
                     document.path, int((total < 1e-6).sum()))  # fmt: skip
        weight[total < 1e-6, 0] = 1.0
    return np.array(skin.joints)[slot], weight / weight.sum(1, keepdims=True)


def _base_color(document: Document, primitive: Object) -> tuple[int, object]:
    """Texture coordinate set and image index of a primitive's base colour; 0 and None if plain."""
    if "material" not in primitive:
        return 0, None
    material = document.item("materials", primitive["material"])
    reference: Any = material.get("pbrMetallicRoughness")
    reference = reference.get("baseColorTexture") if isinstance(reference, dict) else None
    if not isinstance(reference, dict):
        return 0, None
    texture = document.item("textures", reference.get("index"))
    coordinate = document.integer(reference.get("texCoord", 0), "texCoord", 0, 15)
    return coordinate, texture.get("source")


def _assemble(
    document: Document, tree: NodeTree, skins: list[Skin], parts: list[_Part]
) -> Template:
    rest = {
        node: matrix
        for skin in skins[::-1]
        for node, matrix in zip(skin.joints, skin.rest, strict=True)
    }
    bones = _bone_order(tree, skins)
    index = np.zeros(len(tree.world), dtype=np.int64)
    index[bones] = np.arange(len(bones))
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    texture = _first_texture(document, parts)
    weight_bones, weights = _stack_weights(parts)
    return Template(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([p.faces + s for p, s in zip(parts, starts, strict=False)]),
        bone_names=_bone_names(document, bones),
        bone_parents=np.array([_parent_bone(tree, node, index, rest) for node in bones]),
        bone_rest=np.stack([rest[node] for node in bones]),
        weight_bones=index[weight_bones],
        weights=weights,
        uv=_stack_uv(parts),
        texture=texture,
        name=document.path.stem,
    )


def _bone_order(tree: NodeTree, skins: list[Skin]) -> list[int]:
    """Joints as the skins list them if parents come first there, else from the roots down."""
    listed = list(dict.fromkeys(node for skin in skins for node in skin.joints))
    rank = {node: place for place, node in enumerate(listed)}
    for node in listed:
        ancestor = int(tree.parents[node])
        while ancestor >= 0:
            if rank.get(ancestor, -1) > rank[node]:
                return [joint for joint in tree.order if joint in rank]
            ancestor = int(tree.parents[ancestor])
    return listed


def _stack_weights(parts: list[_Part]) -> tuple[Integers, Floats]:
    width = max(part.nodes.shape[1] for part in parts)
    pad = [((0, 0), (0, width - part.nodes.shape[1])) for part in parts]
    nodes = [np.pad(part.nodes, p, mode="edge") for part, p in zip(parts, pad, strict=True)]
    weights = [np.pad(part.weights, p) for part, p in zip(parts, pad, strict=True)]
    return np.concatenate(nodes), np.concatenate(weights)


def _stack_uv(parts: list[_Part]) -> Floats | None:
    if all(part.uv is None for part in parts):
        return None
    return np.concatenate([np.zeros((len(p.vertices), 2)) if p.uv is None else p.uv for p in parts])


def _first_texture(document: Document, parts: list[_Part]) -> bytes | None:
    images = list(dict.fromkeys(p.image for p in parts if isinstance(p.image, int)))
    if not images:
        return None
    if len(images) > 1 or any(part.image is None for part in parts):
        _LOG.warning("%s: several materials; only the first texture is kept", document.path)
    data = document.image(images[0])
    if image_mime(data) is None:
        _LOG.warning("%s: its texture is neither JPEG nor PNG and is left out", document.path)
        return None
    return data


def _bone_names(document: Document, bones: list[int]) -> tuple[str, ...]:
    nodes = document.items("nodes")
    names: dict[str, None] = {}
    for node in bones:
        given = nodes[node].get("name")
        name = given if isinstance(given, str) and given else f"bone_{node}"
        names[name if name not in names else f"{name}_{node}"] = None
    if len(names) != len(bones):
        raise InputError(f"{document.path}: bone names are not unique; rename them")
    return tuple(names)


def _parent_bone(tree: NodeTree, node: int, index: Integers, rest: dict[int, Floats]) -> int:
    """Nearest ancestor that is a bone, -1 if none."""
    parent = int(tree.parents[node])
    while parent >= 0 and parent not in rest:
        parent = int(tree.parents[parent])
    return -1 if parent < 0 else int(index[parent])


def _floats(document: Document, index: object, kind: str, count: int | None = None) -> Floats:
    values = _attribute(document, index, kind, count).astype(np.float64)
    if not np.isfinite(values).all():
        raise document.error(f"accessor {index} holds NaN or infinity; export it again")
    return values


def _attribute(document: Document, index: object, kind: str, count: int | None) -> NDArray[Any]:
    values = document.accessor(index, kind)
    if count is not None and len(values) != count:
        raise document.error(f"accessor {index} has {len(values)} rows for {count} vertices")
    return values
