"""Node hierarchy and skins of a glTF document: where the bones are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.gltf_document import Document, Object

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

UPRIGHT = "upright"
"""In ``extras`` of a node: it turns a captured world upright, and is no part of the rest pose."""

_BIND_TOLERANCE = 1e-3  # metres, and parts of one: below it the nodes stand in the bind pose
_FARTHEST = 1e12  # units: what is beyond is damage, and overflows when it is multiplied
_SHORTEST = 1e-6  # quaternion that still has a direction
_ROUNDING = 1e-5  # below it they differ by what inverse binds, in float32, cannot express


@dataclass(frozen=True, eq=False)
class NodeTree:
    """Node hierarchy: parent index or -1, (N,), and node-to-world transforms (N, 4, 4)."""

    parents: Integers
    world: Floats
    order: tuple[int, ...]  # parents before children, in the order of the file


@dataclass(frozen=True, eq=False)
class Skin:
    """Joint nodes of a skin and the transforms that put its bind pose into the world."""

    joints: tuple[int, ...]
    bind_to_world: Floats  # (4, 4)
    rest: Floats  # (joints, 4, 4), rigid


def read_tree(document: Document) -> NodeTree:
    """Node hierarchy of a file with world transforms, checked to be a forest.

    Nodes that turn a captured world upright (``UPRIGHT``) are taken to turn nothing.
    """
    nodes = document.items("nodes")
    parents = np.full(len(nodes), -1, dtype=np.int64)
    for number, node in enumerate(nodes):
        children = node.get("children", [])
        for value in children if isinstance(children, list) else [children]:
            child = document.integer(value, "node.children", 0, len(nodes) - 1)
            if parents[child] != -1:
                raise document.error(f"damaged file, node {child} has two parents")
            parents[child] = number
    order = _topological_order(document, parents)
    world = np.empty((len(nodes), 4, 4))
    for number in order:
        local = _local_matrix(document, nodes[number])
        if _turns_world(nodes[number]):
            local = np.eye(4)
        parent = parents[number]
        world[number] = local if parent < 0 else world[parent] @ local
        if not np.abs(world[number]).max() < _FARTHEST:
            raise document.error(f"node {number} lies or is scaled beyond {_FARTHEST:g} units")
    return NodeTree(parents, world, order)


def drawn_nodes(document: Document, tree: NodeTree) -> NDArray[np.bool_]:
    """Which nodes programs draw: of the file's own scene, and not hidden (KHR_node_visibility).

    All of a file without scenes.
    """
    scenes = document.items("scenes")
    drawn = np.ones(len(tree.parents), bool)
    if scenes:
        roots = document.item("scenes", document.tree.get("scene", 0)).get("nodes", [])
        drawn[:] = False
        for value in roots if isinstance(roots, list) else [roots]:
            drawn[document.integer(value, "scene.nodes", 0, len(drawn) - 1)] = True
    nodes, tops = document.items("nodes"), drawn.copy()
    for number in tree.order:
        parent = tree.parents[number]
        above = tops[number] if parent < 0 else drawn[parent] or tops[number]
        drawn[number] = above and not _hidden(nodes[number])
    return drawn


def _hidden(node: Object) -> bool:
    extensions = node.get("extensions")
    found = extensions.get("KHR_node_visibility") if isinstance(extensions, dict) else None
    return isinstance(found, dict) and found.get("visible") is False


def _topological_order(document: Document, parents: Integers) -> tuple[int, ...]:
    children: dict[int, list[int]] = {}
    for child, parent in enumerate(parents.tolist()):
        children.setdefault(parent, []).append(child)
    order: list[int] = []
    pending = children.get(-1, [])[::-1]
    while pending:
        order.append(pending.pop())
        pending += children.get(order[-1], [])[::-1]
    if len(order) != len(parents):
        raise document.error("damaged file, its nodes form a cycle")
    return tuple(order)


def _turns_world(node: Object) -> bool:
    extras = node.get("extras")
    return isinstance(extras, dict) and extras.get(UPRIGHT) is True


def _local_matrix(document: Document, node: Object) -> Floats:
    if "matrix" in node:
        return _bounded(document, node["matrix"], 16, "node.matrix").reshape(4, 4).T
    matrix = np.eye(4)
    matrix[:3, 3] = _bounded(document, node.get("translation", [0, 0, 0]), 3, "node.translation")
    quaternion = _bounded(document, node.get("rotation", [0, 0, 0, 1]), 4, "node.rotation")
    if not np.linalg.norm(quaternion) > _SHORTEST:
        raise document.error("damaged file, node.rotation is a zero quaternion")
    scale = _bounded(document, node.get("scale", [1, 1, 1]), 3, "node.scale")
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix() * scale
    return matrix


def _bounded(document: Document, value: object, count: int, what: str) -> Floats:
    numbers = document.numbers(value, count, what)
    if np.abs(numbers).max() > _FARTHEST:
        raise document.error(f"damaged file, {what} holds numbers beyond {_FARTHEST:g}")
    return numbers


def read_skin(
    document: Document, skin: Object, tree: NodeTree, notes: list[Finding] | None = None
) -> Skin:
    """Place the bind pose of a skin in the world.

    A vertex v is drawn at ``world_j @ inverse_bind_j @ v``. Where the nodes stand in the bind
    pose that product is the same for all joints j: it takes mesh units to the world. Otherwise
    the joint nearest to the root decides, and the pose of the others is dropped.
    """
    listed = skin.get("joints")
    if not isinstance(listed, list) or not listed:
        raise document.error("damaged file, a skin has no joints")
    joints = tuple(document.integer(j, "skin.joints", 0, len(tree.world) - 1) for j in listed)
    if len(set(joints)) != len(joints):
        raise document.error("damaged file, a skin lists a joint twice")
    inverse_bind = _inverse_bind(document, skin, len(joints))
    placements = tree.world[list(joints)] @ inverse_bind
    position = {node: place for place, node in enumerate(tree.order)}
    bind_to_world: Floats = placements[min(range(len(joints)), key=lambda j: position[joints[j]])]
    if not abs(np.linalg.det(bind_to_world[:3, :3])) > 0:
        raise document.error("its skeleton is scaled to zero; apply the scale and export again")
    if np.abs(bind_to_world - np.eye(4)).max() < _ROUNDING / 10:
        bind_to_world = np.eye(4)
    posed = np.abs(placements @ np.linalg.inv(bind_to_world) - np.eye(4)).max()
    if posed > _BIND_TOLERANCE and notes is not None:
        what = "nodes are posed; the bind pose is used as rest pose"
        notes.append(Finding(Severity.WARNING, "skeleton", what))
    if posed < _ROUNDING:
        return Skin(joints, bind_to_world, rigid(tree.world[list(joints)]))
    return Skin(joints, bind_to_world, rigid(bind_to_world @ np.linalg.inv(inverse_bind)))


def _inverse_bind(document: Document, skin: Object, joints: int) -> Floats:
    if "inverseBindMatrices" not in skin:
        raise document.error("its skin has no inverse bind matrices; export it again with them")
    raw = document.accessor(skin["inverseBindMatrices"], "MAT4")
    matrices = raw[:joints].reshape(-1, 4, 4).mT.astype(np.float64)
    if len(matrices) < joints:
        raise document.error(f"{len(matrices)} inverse bind matrices for {joints} joints")
    if not np.isfinite(matrices).all() or np.any(np.linalg.det(matrices[:, :3, :3]) == 0):
        raise document.error("its inverse bind matrices cannot be inverted; apply all scales")
    matrices[:, 3] = (0, 0, 0, 1)
    return matrices


def rigid(matrices: Floats) -> Floats:
    """Nearest rigid transforms (N, 4, 4): scale and shear of a bone's axes move no vertex."""
    u, _, vt = np.linalg.svd(matrices[:, :3, :3])
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    result = matrices.copy()
    result[:, :3, :3] = u @ vt
    return result
