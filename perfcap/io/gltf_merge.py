"""Several captured characters in one binary glTF file, moving together."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from perfcap.io.gltf_buffer import Object
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_write import write_glb

_LISTS = (
    *("nodes", "meshes", "skins", "accessors", "bufferViews"),
    *("materials", "textures", "images", "samplers"),
)
_ALIGNED = 4  # bytes


def merge_characters(path: str | Path, characters: Mapping[str, Path]) -> None:
    """Write one file of several that ``save_animation`` wrote.

    Each character hangs on a node of its name; all move in one animation.

    Args:
        path: where to write the ``.glb``.
        characters: files by name.

    Raises:
        InputError: a file cannot be read or written, or they are too large together.
    """
    whole: Object = {
        "asset": {"version": "2.0", "generator": "perfcap"},
        "scene": 0,
        "scenes": [{"nodes": []}],
        "animations": [{"name": "capture", "channels": [], "samplers": []}],
    }
    data = bytearray()
    for name, source in characters.items():
        document = open_document(source)
        data.extend(b"\0" * (-len(data) % _ALIGNED))
        _add(whole, copy.deepcopy(document.tree), name, len(data))
        data.extend(document.buffers[0])
    if not whole["animations"][0]["channels"]:
        del whole["animations"]
    whole["buffers"] = [{"byteLength": len(data)}]
    write_glb(Path(path), whole, data)


def _add(whole: Object, tree: Object, name: str, offset: int) -> None:
    """Append a character's objects; what they refer to has moved behind that of the others."""
    first = {kind: len(whole.get(kind, ())) for kind in _LISTS}
    for view in tree.get("bufferViews", ()):
        view["byteOffset"] = view.get("byteOffset", 0) + offset
    _move_references(tree, first)
    top = tree["scenes"][tree.get("scene", 0)]["nodes"]
    for kind in _LISTS:
        if kind in tree:
            whole.setdefault(kind, []).extend(tree[kind])
    whole["scenes"][0]["nodes"].append(len(whole["nodes"]))
    whole["nodes"].append({"name": name, "children": top})
    merged = whole["animations"][0]
    for animation in tree.get("animations", ()):
        before = len(merged["samplers"])
        for channel in animation["channels"]:
            channel["sampler"] += before
        merged["samplers"] += animation["samplers"]
        merged["channels"] += animation["channels"]


def _move_references(tree: Object, first: Mapping[str, int]) -> None:
    """Add to every index where the list begins that it points into."""
    for scene in tree["scenes"]:
        _shift(scene, "nodes", first["nodes"])
    for node in tree["nodes"]:
        _shift(node, "children", first["nodes"])
        _shift(node, "mesh", first["meshes"])
        _shift(node, "skin", first["skins"])
    for mesh in tree["meshes"]:
        for part in mesh["primitives"]:
            for attributes in (part["attributes"], *part.get("targets", ())):
                for key in attributes:
                    _shift(attributes, key, first["accessors"])
            _shift(part, "indices", first["accessors"])
            _shift(part, "material", first["materials"])
    for skin in tree["skins"]:
        _shift(skin, "joints", first["nodes"])
        _shift(skin, "skeleton", first["nodes"])
        _shift(skin, "inverseBindMatrices", first["accessors"])
    _move_data(tree, first)


def _move_data(tree: Object, first: Mapping[str, int]) -> None:
    for accessor in tree["accessors"]:
        _shift(accessor, "bufferView", first["bufferViews"])
        for part in ("indices", "values"):
            _shift(accessor.get("sparse", {}).get(part, {}), "bufferView", first["bufferViews"])
    for image in tree.get("images", ()):
        _shift(image, "bufferView", first["bufferViews"])
    for texture in tree.get("textures", ()):
        _shift(texture, "sampler", first["samplers"])
        _shift(texture, "source", first["images"])
    for material in tree.get("materials", ()):
        base = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
        _shift(base, "index", first["textures"])
    for animation in tree.get("animations", ()):
        for sampler in animation["samplers"]:
            _shift(sampler, "input", first["accessors"])
            _shift(sampler, "output", first["accessors"])
        for channel in animation["channels"]:
            _shift(channel["target"], "node", first["nodes"])


def _shift(holder: dict[str, Any], key: str, by: int) -> None:
    """Move an index, or a list of them, where there is one."""
    value = holder.get(key)
    if isinstance(value, int):
        holder[key] = value + by
    elif isinstance(value, list):
        holder[key] = [each + by for each in value]
