"""Write a skinned, textured, animated character as one binary glTF 2.0 file."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from perfcap.actor.template import Template, exact_weights
from perfcap.errors import InputError
from perfcap.io import gltf_morph
from perfcap.io.atomic import writing
from perfcap.io.gltf_buffer import ARRAY_BUFFER, ELEMENT_BUFFER, Buffer, Object, index_type
from perfcap.io.gltf_scene import UPRIGHT
from perfcap.io.written_checks import warn_of_rate, warn_of_surface, warn_of_transforms

Floats = NDArray[np.float64]
_Track = tuple[int, str, Floats]  # node, what moves of it, and its values at the keys

_TRIANGLES, _LINEAR, _LINEAR_MIPMAP, _REPEAT = 4, 9729, 9987, 10497
_STILL = 1e-6  # metres, or quaternion entries: less movement than this gets no channel
_RIGID_TOLERANCE = 1e-3


def save_animation(
    path: str | Path,
    template: Template,
    bone_transforms: Floats,
    fps: float,
    surface: Iterable[NDArray[Any]] | None = None,
    capture: str | None = None,
    upright: Floats | None = None,
    *,
    examined: bool = False,
) -> bool:
    """Write an actor in motion; the file appears complete or not at all.

    Args:
        path: where to write the ``.glb``.
        template: the rigged mesh.
        bone_transforms: rigid rest-to-posed transforms of its bones in the world,
            (F, B, 4, 4) m: what moves a vertex that hangs on that bone alone.
        fps: frames per second; frame f is keyed at f / fps seconds.
        surface: vertices in the world in blocks of consecutive frames, (f, V, 3) m each, F in all,
            for morph targets on top of the skinning. They are left out, and ``surface`` is not
            touched, where they would make a file that viewers refuse (``gltf_morph.fits``).
        capture: identity of the capture that the motion belongs to.
        upright: rotation (3, 3) from that world to one with y up, as glTF has it: of a node above
            the bones, so that programs show the motion upright. The rest pose stays as it is for
            ``load_template``, and the world for ``read_bone_transforms``.
        examined: whether the caller has looked for transforms, rates and surfaces that do not
            belong together; else they are warned of.

    Returns:
        Whether the file shows all that was given: False where the surface was left out.

    Raises:
        InputError: another name, wrong shapes, transforms that are not finite and rigid, or fps
            not positive.
    """
    if Path(path).suffix.lower() != ".glb":
        raise InputError(f"{path}: the actor is written as binary glTF; end the name in .glb")
    transforms = _checked(template, bone_transforms, fps)
    if not examined:
        warn_of_rate(fps, level=2)
        warn_of_transforms(template, transforms, level=2)
    fits = surface is None or gltf_morph.fits(len(transforms), len(template.vertices))
    buffer = Buffer()
    mesh = _mesh(buffer, template)
    tracks = list(_tracks(template, transforms))
    if surface is not None and fits:
        skin = (template.weight_bones, exact_weights(template.weights))
        targets, apart = gltf_morph.add_targets(
            buffer, template.vertices, skin, transforms, surface
        )
        if not examined:
            warn_of_surface(apart, level=2)
        mesh["primitives"][0]["targets"] = targets
        mesh["extras"] = {"targetNames": [f"frame_{i}" for i in range(len(targets))]}
        tracks.append((len(template.bone_names), "weights", gltf_morph.one_hot(len(targets))))
    tree = _tree(buffer, template, mesh, capture)
    if upright is not None and not np.array_equal(upright, np.eye(3)):
        _hold_upright(tree, upright)
    if tracks:
        tree["animations"] = [_animation(buffer, tracks, np.arange(len(transforms)) / fps)]
    tree |= {"accessors": buffer.accessors, "bufferViews": buffer.views}
    tree["buffers"] = [{"byteLength": len(buffer.data)}]
    write_glb(Path(path), tree, buffer.data)
    return fits


def _tree(buffer: Buffer, template: Template, mesh: Object, capture: str | None) -> Object:
    """The document of a skinned mesh at rest, without what its buffer holds."""
    return {
        "asset": _asset(capture),
        "scene": 0,
        "scenes": [{"nodes": _top(template)}],
        "nodes": _nodes(template),
        "meshes": [mesh],
        "skins": [_skin(buffer, template)],
        **_material(buffer, template),
    }


def _checked(template: Template, bone_transforms: Floats, fps: float) -> Floats:
    transforms = np.asarray(bone_transforms, dtype=np.float64)
    expected = (len(template.bone_names), 4, 4)
    if transforms.ndim != 4 or transforms.shape[1:] != expected or not len(transforms):
        raise InputError(
            f"bone_transforms has shape {transforms.shape}; expected (frames, *{expected})"
        )
    rotation = transforms[..., :3, :3]
    if not np.isfinite(transforms).all() or (
        np.abs(rotation @ rotation.mT - np.eye(3)).max() > _RIGID_TOLERANCE
        or np.linalg.det(rotation).min() < 0
        or np.abs(transforms[..., 3, :] - np.eye(4)[3]).max() > _RIGID_TOLERANCE
    ):
        raise InputError(
            "bone_transforms holds matrices that are not finite and rigid: expected a rotation "
            "without a scale, a translation in the last column, and 0 0 0 1 below"
        )
    if not (np.isfinite(fps) and fps > 0):
        raise InputError(f"fps is {fps}; expected a positive number of frames per second")
    return transforms


def _roots(template: Template) -> list[int]:
    return np.flatnonzero(template.bone_parents < 0).tolist()


def _top(template: Template) -> list[int]:
    """Nodes at the top of the scene: what holds the bones, and the mesh."""
    mesh = len(template.bone_names)
    return [*(_roots(template) if template.space is None else [mesh + 1]), mesh]


def _to_parent(template: Template, transforms: Floats | None = None) -> Floats:
    """Bone-to-parent transforms (..., B, 4, 4) in the file's units, posed by rest-to-posed ones."""
    world = template.bone_frames()
    world = world if transforms is None else transforms @ world
    inverse = np.linalg.inv(world)
    frame = np.eye(4) if template.space is None else np.linalg.inv(template.space.frame)
    parents = template.bone_parents
    is_root = (parents < 0)[:, None, None]
    above = np.where(is_root, frame, inverse[..., np.maximum(parents, 0), :, :])
    local: Floats = above @ world
    return local


def _unscaled(local: Floats) -> tuple[Floats, Floats]:
    """Rotations (..., 3, 3) and scales (...) of transforms that scale evenly."""
    scale = np.cbrt(np.linalg.det(local[..., :3, :3]))
    return local[..., :3, :3] / scale[..., None, None], scale


def _quaternions(rotations: Floats) -> Floats:
    """Unit quaternions (x, y, z, w) of nearly orthonormal matrices (..., 3, 3)."""
    flat: Floats = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat(canonical=True)
    return flat.reshape(*rotations.shape[:-2], 4)


def _nodes(template: Template) -> list[Object]:
    local = _to_parent(template)
    turn, scale = _unscaled(local)
    rotation = _quaternions(turn)
    nodes: list[Object] = []
    for bone, name in enumerate(template.bone_names):
        node: Object = {
            "name": name,
            "translation": local[bone, :3, 3].tolist(),
            "rotation": rotation[bone].tolist(),
        }
        if abs(scale[bone] - 1) > _STILL:
            node["scale"] = [float(scale[bone])] * 3
        children = np.flatnonzero(template.bone_parents == bone).tolist()
        nodes.append(node | {"children": children} if children else node)
    # A skinned mesh at the top of the scene: transforms above it would be ignored anyway.
    nodes.append({"name": template.name, "mesh": 0, "skin": 0})
    return nodes if template.space is None else [*nodes, _holder(template, template.space.frame)]


def _hold_upright(tree: Object, upright: Floats) -> None:
    """Put a node that turns all bones above them; of a skinned mesh it would be ignored."""
    (scene,), nodes = tree["scenes"], tree["nodes"]
    mesh = next(number for number, node in enumerate(nodes) if "mesh" in node)
    bones = [number for number in scene["nodes"] if number != mesh]
    turn = {"rotation": _quaternions(upright).tolist(), "children": bones}
    scene["nodes"] = [len(nodes), mesh]
    nodes.append({"name": f"{nodes[mesh]['name']}_upright", **turn, "extras": {UPRIGHT: True}})
    # Blender takes bind matrices to be relative to what holds the skeleton, where one is named
    tree["skins"][0].pop("skeleton", None)


def _holder(template: Template, frame: Floats) -> Object:
    """The node above the bones that takes their space to the world."""
    turn, scale = _unscaled(frame)
    return {
        "name": f"{template.name}_space",
        "translation": frame[:3, 3].tolist(),
        "rotation": _quaternions(turn).tolist(),
        "scale": [float(scale)] * 3,
        "children": _roots(template),
    }


def _mesh(buffer: Buffer, template: Template) -> Object:
    bones = "u1" if len(template.bone_names) <= 256 else "u2"
    indices = index_type(len(template.vertices))
    attributes = {
        "POSITION": buffer.add(template.vertices, "f4", ARRAY_BUFFER, bounds=True),
        "NORMAL": buffer.add(vertex_normals(template), "f4", ARRAY_BUFFER),
    }
    if template.uv is not None:
        attributes["TEXCOORD_0"] = buffer.add(template.uv, "f4", ARRAY_BUFFER)
    weights = exact_weights(template.weights)
    weight_bones = np.where(weights > 0, template.weight_bones, 0)
    attributes["JOINTS_0"] = buffer.add(weight_bones, bones, ARRAY_BUFFER)
    attributes["WEIGHTS_0"] = buffer.add(weights, "f4", ARRAY_BUFFER)
    primitive = {
        "attributes": attributes,
        "indices": buffer.add(template.faces.reshape(-1, 1), indices, ELEMENT_BUFFER),
        "mode": _TRIANGLES,
        "material": 0,
    }
    return {"name": template.name, "primitives": [primitive]}


def vertex_normals(template: Template) -> Floats:
    """Unit normals weighted by triangle area, smooth across texture seams, (V, 3).

    Vertices without area get +y: a file must not hold a zero normal.
    """
    index, representative = template.weld()
    corners = template.vertices[template.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros((len(representative), 3))
    np.add.at(total, index[template.faces], area[:, None])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    normals = np.where(length > 0, total / np.where(length > 0, length, 1), (0.0, 1.0, 0.0))
    return normals[index]


def _skin(buffer: Buffer, template: Template) -> Object:
    inverse = np.linalg.inv(template.bone_frames())
    inverse[:, 3] = (0, 0, 0, 1)
    roots = _roots(template)
    skin: Object = {
        "inverseBindMatrices": buffer.add(inverse.mT, "f4"),  # column-major
        "joints": list(range(len(template.bone_names))),
    }
    # Blender takes bind matrices to be relative to what holds the skeleton, where one is named; a
    # holder that scales would put its root elsewhere.
    named = len(roots) == 1 and template.space is None
    return skin | {"skeleton": roots[0]} if named else skin


def _material(buffer: Buffer, template: Template) -> Object:
    surface: Object = {"metallicFactor": 0.0, "roughnessFactor": 0.9}
    material = {"name": template.name, "pbrMetallicRoughness": surface, "doubleSided": True}
    if template.texture is None or template.uv is None:
        surface["baseColorFactor"] = [0.7, 0.7, 0.7, 1.0]
        return {"materials": [material]}
    surface["baseColorTexture"] = {"index": 0}
    view = buffer.add_bytes(template.texture)
    sampler = {
        "magFilter": _LINEAR,
        "minFilter": _LINEAR_MIPMAP,
        "wrapS": _REPEAT,
        "wrapT": _REPEAT,
    }
    return {
        "materials": [material],
        "textures": [{"sampler": 0, "source": 0}],
        "images": [{"bufferView": view, "mimeType": template.texture_mime}],
        "samplers": [sampler],
    }


def _tracks(template: Template, transforms: Floats) -> Iterator[_Track]:
    """What moves against its parent; other bones keep their rest transform."""
    local, rest = _to_parent(template, transforms), _to_parent(template)
    turned, turned_rest = (_quaternions(_unscaled(each)[0]) for each in (local, rest))
    tracks = {
        "translation": (local[..., :3, 3], rest[:, :3, 3]),
        "rotation": (_continuous(turned), turned_rest),
    }
    for bone in range(len(template.bone_names)):
        for path, (values, resting) in tracks.items():
            if _distance(values[:, bone], resting[bone], path).max() >= _STILL:
                yield bone, path, values[:, bone]


def _animation(buffer: Buffer, tracks: list[_Track], times: Floats) -> Object:
    """Channels and samplers of nodes' tracks, all keyed at the same times (F,) s."""
    time = buffer.add(times, "f4", bounds=True)
    animation: Object = {"name": "capture", "channels": [], "samplers": []}
    for number, (node, path, values) in enumerate(tracks):
        sampler = {"input": time, "output": buffer.add(values, "f4"), "interpolation": "LINEAR"}
        animation["samplers"].append(sampler)
        animation["channels"].append({"sampler": number, "target": {"node": node, "path": path}})
    return animation


def _asset(capture: str | None) -> Object:
    asset: Object = {"version": "2.0", "generator": "perfcap"}
    return asset if capture is None else asset | {"extras": {"capture": capture}}


def _distance(values: Floats, resting: Floats, path: str) -> Floats:
    """Largest difference of each frame's entries from rest; q and -q are the same rotation."""
    apart: Floats = np.abs(values - resting).max(-1)
    return np.minimum(apart, np.abs(values + resting).max(-1)) if path == "rotation" else apart


def _continuous(quaternions: Floats) -> Floats:
    """Flip signs along time so that neighbours lie on one half-sphere, (F, B, 4)."""
    agreement = (quaternions[1:] * quaternions[:-1]).sum(-1)
    signs = np.cumprod(np.where(agreement < 0, -1.0, 1.0), axis=0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs[..., None]])


def write_glb(path: Path, tree: Object, binary: bytearray) -> None:
    """Write a tree and its one buffer; the file appears complete or not at all."""
    text = json.dumps(tree, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(binary)
    if size >= 1 << 32:
        raise InputError(f"{path}: {size} bytes exceed the 4 GB of a GLB; write fewer frames")
    with writing(path) as file:
        file.write(struct.pack("<4sII", b"glTF", 2, size))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(binary), b"BIN\0"))
        file.write(binary)
