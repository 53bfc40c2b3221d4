"""Small glTF files for tests, and what a file says when it is played."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from perfcap.actor.template import Template
from perfcap.io.gltf_document import open_document

ROOT = Path(__file__).parents[2]
CODES = {"u1": 5121, "u2": 5123, "f4": 5126}
WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Builder:
    """A hand-made glTF, as other programs write them."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0"}, "accessors": [], "bufferViews": []
        }  # fmt: skip

    def add(self, values: object, dtype: str = "f4", **extra: object) -> int:
        rows = np.asarray(values)
        rows = np.ascontiguousarray(rows.reshape(len(rows), -1), dtype="<" + dtype)
        data = rows.tobytes()
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.tree["bufferViews"].append(view)
        self.data += data + bytes(-len(data) % 4)
        entry = {"bufferView": len(self.tree["bufferViews"]) - 1, "count": len(rows)}
        entry |= {"componentType": CODES[dtype], "type": WIDTHS[rows.shape[1]], **extra}
        self.tree["accessors"].append(entry)
        return len(self.tree["accessors"]) - 1

    def write_gltf(self, path: Path, embed: bool = True) -> Path:
        uri = "mesh%20data.bin"
        if embed:
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        else:
            (path.parent / "mesh data.bin").write_bytes(self.data)
        self.tree["buffers"] = [{"byteLength": len(self.data), "uri": uri}]
        path.write_text(json.dumps(self.tree))
        return path


def armature_file() -> Builder:
    """Two primitives in centimetres under an armature scaled by 0.01 and lying on its back.

    The bone chain is hips - (a node that is no joint) - chest, 50 cm apart along the mesh's z.
    """
    builder = Builder()
    mesh = np.array([[0, 0, 0], [10, 0, 0], [0, 0, 50], [10, 0, 50]], dtype=float)
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[0, 2, 3] = -50.0  # chest is listed first
    primitive = {
        "attributes": {
            "POSITION": builder.add(mesh),
            "JOINTS_0": builder.add([[1, 0, 0, 0]] * 2 + [[0, 1, 0, 0]] * 2, "u2"),
            "WEIGHTS_0": builder.add([[255, 0, 0, 0]] * 2 + [[153, 51, 0, 0]] * 2, "u1",
                                     normalized=True),
            "JOINTS_1": builder.add([[0, 0, 0, 0]] * 4, "u1"),
            "WEIGHTS_1": builder.add([[0, 0, 0, 0]] * 2 + [[51, 0, 0, 0]] * 2, "u1",
                                     normalized=True),
        },
        "indices": builder.add([0, 1, 2, 1, 3, 2], "u2"),
    }  # fmt: skip
    plain = {
        "attributes": {
            "POSITION": builder.add(mesh[:3]),
            "JOINTS_0": builder.add([[0, 0, 0, 0]] * 3, "u1"),
            "WEIGHTS_0": builder.add([[1, 0, 0, 0]] * 3),
        }
    }
    back = Rotation.from_euler("x", -90, degrees=True).as_quat().tolist()
    builder.tree |= {
        "nodes": [
            {"name": "chest", "translation": [0, 0, 20]},
            {"name": "body", "mesh": 0, "skin": 0},
            {"name": "helper", "translation": [0, 0, 30], "children": [0]},
            {"name": "hips", "children": [2]},
            {"name": "armature", "rotation": back, "scale": [0.01] * 3, "children": [3, 1]},
        ],
        "meshes": [{"primitives": [primitive, plain]}],
        "skins": [{"joints": [0, 3], "inverseBindMatrices": builder.add(inverse.mT)}],
    }
    return builder


def bar(columns: int = 9) -> Template:
    """A textured tube on a chain of three bones and a weightless tip, with unequal axes."""
    y, around = np.meshgrid(np.linspace(0, 1.5, 7), np.linspace(0, 2 * np.pi, columns))
    vertices = np.stack([0.1 * np.cos(around), y, 0.1 * np.sin(around)], -1).reshape(-1, 3)
    corner = np.arange(columns - 1)[:, None] * 7 + np.arange(6)
    quads = [corner, corner + 1, corner + 7, corner + 8]
    faces = np.concatenate([np.stack(quads[:3], -1), np.stack([quads[1], quads[3], quads[2]], -1)])
    rest = np.tile(np.eye(4), (4, 1, 1))
    rest[:, 1, 3] = (0, 0.5, 1.0, 1.5)
    rest[:, :3, :3] = Rotation.random(4, rng=np.random.default_rng(1)).as_matrix()
    share = np.clip(1 - 2 * np.abs(vertices[:, 1:2] - np.array([0.25, 0.75, 1.25])), 1e-3, None)
    return Template(
        vertices=vertices,
        faces=faces.reshape(-1, 3),
        bone_names=("hips", "chest", "neck", "top"),
        bone_parents=np.array([-1, 0, 1, 2]),
        bone_rest=rest,
        weight_bones=np.tile([0, 1, 2], (len(vertices), 1)),
        weights=share / share.sum(1, keepdims=True),
        uv=np.stack([around, y], -1).reshape(-1, 2) / 7,
        texture=one_pixel_png(),
    )


def one_pixel_png() -> bytes:
    return base64.b64decode(
        "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4z8AAAAMBAQDJ/pLvAAAAAElFTkSuQmCC"
    )


def random_motion(template: Template, frames: int) -> np.ndarray:
    """Rest-to-posed transforms of a chain that turns more than half round in places."""
    rng = np.random.default_rng(0)
    turns = np.cumsum(rng.normal(0, 0.5, (frames, len(template.bone_names), 3)), axis=0)
    posed = np.empty((*turns.shape[:2], 4, 4))
    for bone, parent in enumerate(template.bone_parents):
        local = np.tile(np.eye(4), (frames, 1, 1))
        local[:, :3, :3] = Rotation.from_rotvec(turns[:, bone]).as_matrix()
        pivot = template.bone_rest[bone, :3, 3]
        local[:, :3, 3] = pivot - local[:, :3, :3] @ pivot
        if parent < 0:
            local[:, :3, 3] += rng.normal(size=(frames, 3))
        posed[:, bone] = local if parent < 0 else posed[:, parent] @ local
    posed[:, -1] = posed[:, -2]  # the weightless tip does not move on its own
    return posed


def skinned(template: Template, transforms: np.ndarray) -> np.ndarray:
    homogeneous = np.c_[template.vertices, np.ones(len(template.vertices))]
    blended = np.einsum("vb,fbij->fvij", template.dense_weights(), transforms)
    return np.einsum("fvij,vj->fvi", blended, homogeneous)[..., :3]


def played(path: Path, time: float, skin_number: int = 0) -> np.ndarray:
    """Vertices of a file at a time by the rules of the specification, from its raw accessors."""
    document = open_document(path)
    tree = document.tree
    nodes = [dict(node) for node in tree["nodes"]]
    for channel in tree["animations"][0]["channels"]:
        if channel["target"]["path"] == "weights":  # of morph targets, which are left out
            continue
        sampler = tree["animations"][0]["samplers"][channel["sampler"]]
        keys = document.accessor(sampler["input"], "SCALAR")[:, 0]
        kind = "VEC4" if channel["target"]["path"] == "rotation" else "VEC3"
        values = document.accessor(sampler["output"], kind)
        if kind == "VEC4":
            value = Slerp(keys, Rotation.from_quat(values))(time).as_quat()
        else:
            value = [np.interp(time, keys, values[:, axis]) for axis in range(3)]
        nodes[channel["target"]["node"]][channel["target"]["path"]] = value
    world: dict[int, np.ndarray] = {}

    def visit(number: int, above: np.ndarray) -> None:
        local = np.eye(4)
        local[:3, :3] = Rotation.from_quat(nodes[number].get("rotation", (0, 0, 0, 1))).as_matrix()
        local[:3, 3] = nodes[number].get("translation", (0, 0, 0))
        world[number] = above @ local
        for child in nodes[number].get("children", []):
            visit(child, world[number])

    for root in tree["scenes"][0]["nodes"]:
        visit(root, np.eye(4))
    (mesh,) = (node["mesh"] for node in nodes if node.get("skin") == skin_number)
    skin = tree["skins"][skin_number]
    attributes = tree["meshes"][mesh]["primitives"][0]["attributes"]
    inverse = document.accessor(skin["inverseBindMatrices"], "MAT4").reshape(-1, 4, 4).mT
    matrices = np.stack([world[joint] for joint in skin["joints"]]) @ inverse
    bones = document.accessor(attributes["JOINTS_0"], "VEC4")
    weights = document.accessor(attributes["WEIGHTS_0"], "VEC4")
    points = np.c_[document.accessor(attributes["POSITION"], "VEC3"), np.ones(len(bones))]
    return np.einsum("vk,vkij,vj->vi", weights, matrices[bones], points)[:, :3]
