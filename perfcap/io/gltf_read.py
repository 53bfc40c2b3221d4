"""Read a rigged character from a skinned glTF 2.0 file."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_space import BoneSpace, is_similarity
from perfcap.actor.template import Template
from perfcap.errors import InputError
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.gltf_alpha import see_through
from perfcap.io.gltf_document import Document, open_document
from perfcap.io.gltf_part import Part, joined, joined_uv, read_parts
from perfcap.io.gltf_scene import NodeTree, Skin, read_tree
from perfcap.io.gltf_texture import one_texture

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_LOG = logging.getLogger(__name__)
_PLAIN = 1e-5  # parts of one: less scale or turn than this is rounding of the file
_SMALLEST = 1e-12  # scale of a bone that is not damage
_EVEN = 1e-2  # difference of a bone's scales along its axes that is put up with


@dataclass(frozen=True, eq=False)
class Character:
    """A template as its file has it, and what a user should know about the file.

    Attributes:
        template: the rigged mesh.
        parts: name and number of vertices of each part, in the order of the vertices.
        findings: what is odd about the file.
        copyright: what the file says about its rights.
        nodes: of the file, for each bone.
    """

    template: Template
    parts: tuple[tuple[str, int], ...]
    findings: tuple[Finding, ...]
    copyright: str | None = None
    nodes: tuple[int, ...] = ()


def load_template(path: str | Path) -> Template:
    """Load the skinned mesh of a ``.glb`` or ``.gltf`` as a `Template`.

    The inverse bind matrices decide the rest pose; the nodes place it in the world, so scaled or
    turned armatures come out in metres, y up. All primitives of all skinned meshes are merged, and
    meshes that hang on a bone go with it. Joints without weights are kept as bones: they mark
    places such as the top of the head.

    Raises:
        InputError: the file is missing, damaged, compressed, or has no skinned mesh.
    """
    return read_template(open_document(Path(path)))


def read_template(document: Document) -> Template:
    """Like ``load_template``, of a file that is already open."""
    character = read_character(document)
    for finding in character.findings:
        if finding.severity is not Severity.INFO:
            _LOG.warning("%s: %s", document.path, finding)
    return character.template


def read_character(document: Document) -> Character:
    """The template of an open file with all there is to say about it.

    Raises:
        InputError: it is damaged, or has no skinned mesh.
    """
    tree = read_tree(document)
    notes: list[Finding] = []
    parts, skins = read_parts(document, tree, notes)
    if not parts:
        raise document.error(
            "has no skinned mesh; bind the mesh to a skeleton, or use `perfcap actor build`"
        )
    notes += see_through(document, parts)
    notes += _several(document, skins)
    bones = _bone_order(tree, skins)
    template = _assemble(document, tree, skins, bones, parts, notes)
    asset = document.tree.get("asset")
    rights = asset.get("copyright") if isinstance(asset, dict) else None
    return Character(
        template,
        tuple((part.name, len(part.vertices)) for part in parts),
        tuple(notes),
        rights if isinstance(rights, str) else None,
        tuple(bones),
    )


def _assemble(
    document: Document,
    tree: NodeTree,
    skins: list[Skin],
    bones: list[int],
    parts: list[Part],
    notes: list[Finding],
) -> Template:
    rest = {
        node: matrix
        for skin in skins[::-1]
        for node, matrix in zip(skin.joints, skin.rest, strict=True)
    }
    index = np.zeros(len(tree.world), dtype=np.int64)
    index[bones] = np.arange(len(bones))
    vertices, faces = joined(parts)
    texture, coordinates = one_texture(
        document,
        [part.material for part in parts],
        [part.uv for part in parts],
        notes,
        [part.faces for part in parts],
    )
    weight_bones, weights = _stack_weights(parts)
    parents = np.array([_parent_bone(tree, node, index, rest) for node in bones])
    return Template(
        vertices=vertices,
        faces=faces,
        bone_names=_bone_names(document, bones),
        bone_parents=parents,
        bone_rest=np.stack([rest[node] for node in bones]),
        weight_bones=index[weight_bones],
        weights=weights,
        uv=joined_uv(parts, coordinates),
        texture=texture,
        name=document.path.stem,
        space=_space(tree, bones, parents, notes),
    ).rounded()


def _several(document: Document, skins: list[Skin]) -> Iterator[Finding]:
    """That a file holds skeletons of several people, of which one is taken."""
    apart: list[set[int]] = []
    for skin in skins:
        own = set(skin.joints)
        apart, joined = [a for a in apart if not a & own], [a for a in apart if a & own]
        apart.append(own.union(*joined))
    people = [joints for joints in apart if len(joints) >= len(JOINTS)]
    if len(people) > 1:
        nodes = document.items("nodes")
        names = ", ".join(repr(nodes[min(joints)].get("name", ""))[:40] for joints in people)
        what = f"{len(people)} skeletons of a person's size, with {names}; one of them is taken"
        remedy = "save each person in a file of their own"
        yield Finding(Severity.WARNING, "skeleton", what, remedy)


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


def _space(
    tree: NodeTree, bones: list[int], parents: Integers, notes: list[Finding]
) -> BoneSpace | None:
    """Units and frame of the bones; None where they are metres in the world."""
    linear = tree.world[bones][:, :3, :3]
    sizes = np.linalg.svd(linear, compute_uv=False)
    uneven = np.any(sizes[:, 2] < (1 - _EVEN) * sizes[:, 0]) or not sizes.min() > _SMALLEST
    holder = int(tree.parents[bones[int(np.argmax(parents < 0))]])
    frame = np.eye(4) if holder < 0 else tree.world[holder].copy()
    if uneven or np.any(np.linalg.det(linear) < 0) or not is_similarity(frame):
        what = "bones are mirrored, or scaled differently along their axes"
        remedy = "apply the scale of the armature if animations should play on this very file"
        notes.append(Finding(Severity.WARNING, "skeleton", what, remedy))
        return None
    units = np.cbrt(sizes.prod(1))
    for usual in (float(np.median(units)), 1.0):  # programs multiply many float32 rotations
        units[np.abs(units / usual - 1) < _PLAIN] = usual
    if np.abs(frame - np.eye(4)).max() < _PLAIN:
        frame = np.eye(4)
    space = BoneSpace(units, frame)
    return None if space.is_plain() else space


def _stack_weights(parts: list[Part]) -> tuple[Integers, Floats]:
    width = max(part.nodes.shape[1] for part in parts)
    pad = [((0, 0), (0, width - part.nodes.shape[1])) for part in parts]
    nodes = [np.pad(part.nodes, p, mode="edge") for part, p in zip(parts, pad, strict=True)]
    weights = [np.pad(part.weights, p) for part, p in zip(parts, pad, strict=True)]
    return np.concatenate(nodes), np.concatenate(weights)


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
