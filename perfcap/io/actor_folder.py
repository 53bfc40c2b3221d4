"""An actor as a folder: ``actor.glb`` that any program opens, and ``manifest.toml`` beside it.

The manifest says what a glTF has no place for: which bone is which joint, landmarks, joint limits
that differ from the usual ones, where the actor comes from and under which licence.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS, human_rig
from perfcap.actor.rig import with_limits
from perfcap.actor.template import Template
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.actor_place import MANIFEST, MESH, WHAT, of_earlier
from perfcap.io.atomic import writing
from perfcap.io.files import MEBIBYTE, read_toml
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_read import read_template
from perfcap.io.gltf_write import save_animation
from perfcap.io.publish import publishing

_LOG = logging.getLogger(__name__)

UNKNOWN = "unknown"
_KEYS = {
    *("name", "licence", "provenance", "generic", "shape_space", "joints", "landmarks", "limits"),
    "file",  # of models that are shipped
}
_SAME = 1e-9  # rad; limits nearer than this are the usual ones


@dataclass(frozen=True)
class Manifest:
    """What is known about an actor besides its mesh.

    Attributes:
        name: what to call it.
        licence: under which it may be used.
        provenance: where it comes from.
        generic: whether it stands for anybody, so that bone lengths should be solved.
        shape_space: file beside the manifest with its shape space, if it has one.
        joints: names of bones by joint; empty where bones are called like their joints.
        landmarks: name of a bone and rest position, m, by landmark.
        limits: lower and upper limit by angle, rad, where they differ from the usual ones.
        digest: SHA-256 of the mesh that it was written for, in hexadecimal.
    """

    name: str | None = None
    licence: str = UNKNOWN
    provenance: str = UNKNOWN
    generic: bool = False
    shape_space: str | None = None
    joints: Mapping[str, str] = field(default_factory=dict)
    landmarks: Mapping[str, tuple[str, tuple[float, float, float]]] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    digest: str = UNKNOWN


def spare_actor(folder: Path, name: str) -> None:
    """Refuse to replace somebody else; an actor of this name may be made again.

    Raises:
        InputError: the folder holds an actor of another name.
    """
    there = read_manifest(folder / MANIFEST)
    if there.name not in (None, name):
        raise InputError(
            f"--out {folder}: holds the actor {there.name!r:.60} ({there.provenance:.80}), not "
            f"{name!r:.60}; choose another folder, or delete it"
        )


def save_actor(
    actor: Actor,
    folder: str | Path,
    *,
    licence: str = UNKNOWN,
    provenance: str = UNKNOWN,
    generic: bool = False,
    shape_space: str | None = None,
    beside: Callable[[Path], None] | None = None,
) -> None:
    """Write an actor as a folder that ``load_actor`` reads back.

    Vertices, texture coordinates, weights and texture come back bit for bit if the template is
    ``rounded``, as all that perfcap reads or imports is. The files appear complete, together; what
    tells of an earlier actor there (its contact sheet, measurements, fitted body) goes with it.

    Args:
        actor: what to write; its skeleton is the human one.
        folder: made if it does not exist.
        licence: such as ``CC0-1.0``.
        provenance: where the actor comes from.
        generic: whether it stands for anybody rather than for one person.
        shape_space: name of a file in the folder that holds its shape space.
        beside: writes files that tell of the actor into a folder that it is given, which appear
            together with it.

    Raises:
        InputError: another skeleton, or a folder that cannot be written.
    """
    folder, template = Path(folder), actor.template
    manifest = Manifest(
        template.name,
        licence,
        provenance,
        generic,
        shape_space,
        {name: template.bone_names[bone] for name, bone in _joint_bones(template).items()},
        {n: (template.bone_names[b], _triple(p)) for n, (b, p) in _landmarks(template).items()},
        _own_limits(actor),
    )
    still = np.eye(4)[None, None].repeat(len(template.bone_names), 1)

    def gone(place: Path) -> list[str]:
        return [name for name in of_earlier(place) if name != shape_space]

    with publishing(folder, gone) as scratch:
        save_animation(scratch / MESH, template, still, fps=1.0)
        with writing(scratch / MANIFEST) as file:
            file.write("\n".join([*_lines(manifest, scratch / MESH), ""]).encode())
        if beside is not None:
            beside(scratch)


def _joint_bones(template: Template) -> Mapping[str, int]:
    named = {name: bone for bone, name in enumerate(template.bone_names) if name in JOINTS}
    return template.joint_bones or named


def _landmarks(template: Template) -> Mapping[str, tuple[int, Any]]:
    """Points of the template, and bones of that name, whose parents carry them."""
    bones = {
        name: (max(int(template.bone_parents[bone]), 0), template.bone_rest[bone, :3, 3])
        for bone, name in enumerate(template.bone_names)
        if name in LANDMARKS and name not in JOINTS
    }
    return {**bones, **template.landmarks}


def _own_limits(actor: Actor) -> dict[str, tuple[float, float]]:
    """Limits that differ from those that the joints' places give."""
    rig = actor.skeleton.rig
    if rig.joints[: len(JOINTS)] != JOINTS:
        raise InputError(
            f"actor {actor.template.name!r}: has a skeleton of its own; only actors with the human "
            "one are written as folders"
        )
    places = zip((*rig.joints, *rig.landmarks), (*rig.positions, *rig.landmark_positions),
                 strict=True)  # fmt: skip
    usual = {hinge.name: hinge for hinge in human_rig(dict(places)).hinges}
    return {
        hinge.name: (hinge.lower, hinge.upper)
        for hinge in rig.hinges
        if abs(hinge.lower - usual[hinge.name].lower) > _SAME
        or abs(hinge.upper - usual[hinge.name].upper) > _SAME
    }


def _triple(place: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in place)
    return x, y, z


def _lines(manifest: Manifest, mesh: Path) -> Iterator[str]:
    """The manifest as TOML."""
    data = mesh.read_bytes()
    yield "# What this actor is; `perfcap actor inspect` reads it."
    for key in ("name", "licence", "provenance", "generic", "shape_space"):
        value = getattr(manifest, key)
        if value is not None:
            yield f"{key} = {_toml(value)}"
    yield from ("", "[[file]]", f"name = {_toml(mesh.name)}", f"size = {len(data)}")
    yield f'sha256 = "{hashlib.sha256(data).hexdigest()}"'
    yield from ("", "[joints]  # bones of the skeleton's joints")
    for joint, bone in manifest.joints.items():
        yield f"{joint} = {_toml(bone)}"
    for name, (bone, place) in manifest.landmarks.items():
        yield from ("", f"[landmarks.{name}]  # metres, in the rest pose", f"bone = {_toml(bone)}")
        yield f"position = [{', '.join(map(repr, place))}]"
    if manifest.limits:
        yield from ("", "[limits]  # degrees")
    for name, limits in manifest.limits.items():
        yield f"{name} = [{', '.join(repr(math.degrees(limit)) for limit in limits)}]"


def _toml(value: str | bool) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    # JSON's strings are TOML's, but for one character that JSON leaves as it is
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def load_actor_folder(folder: Path) -> Actor:
    """Read what ``save_actor`` wrote, in float64.

    Raises:
        InputError: files are missing, damaged, or do not belong together.
    """
    manifest = read_manifest(folder / MANIFEST)
    template = read_template(open_document(folder / MESH))
    bones = {name: bone for bone, name in enumerate(template.bone_names)}
    named = {*manifest.joints.values(), *(bone for bone, _ in manifest.landmarks.values())}
    if named - bones.keys():
        raise InputError(
            f"{folder / MANIFEST}: names the bones {', '.join(sorted(named - bones.keys()))}, "
            f"which {MESH} lacks; build the actor again"
        )
    template = replace(
        template,
        name=manifest.name or template.name,
        joint_bones={joint: bones[bone] for joint, bone in manifest.joints.items()},
        landmarks={n: (bones[b], np.array(p)) for n, (b, p) in manifest.landmarks.items()},
    )
    return limited(Actor(template), manifest, folder).to(torch.float64)


def limited(actor: Actor, manifest: Manifest, folder: Path) -> Actor:
    """The actor with the joint limits of its manifest.

    Raises:
        InputError: they are no limits of its angles.
    """
    if not manifest.limits:
        return actor
    try:
        return Actor(actor.template, with_limits(actor.skeleton.rig, manifest.limits))
    except InputError as error:
        raise InputError(f"{folder / MANIFEST}: {error}") from None


def read_manifest(path: Path) -> Manifest:
    """What a manifest says; nothing is known where there is none.

    Raises:
        InputError: it is not a manifest.
    """
    if not path.is_file():
        return Manifest()
    values = read_toml(path, WHAT, MEBIBYTE)
    unknown = sorted(set(values) - _KEYS)
    if unknown:
        _LOG.warning(
            "%s: %s are not known and count for nothing; expected some of %s",
            path, ", ".join(unknown)[:80], ", ".join(sorted(_KEYS)),
        )  # fmt: skip
    joints = _table(path, values, "joints", lambda bone: isinstance(bone, str))
    if joints and joints.keys() != set(JOINTS):
        raise InputError(f"{path}: joints are {', '.join(joints)}; expected {', '.join(JOINTS)}")
    limits = _table(path, values, "limits", lambda pair: _is_numbers(pair, 2))
    _require_degrees(path, limits)
    landmarks = _table(
        path,
        values,
        "landmarks",
        lambda mark: (
            isinstance(mark, dict)
            and isinstance(mark.get("bone"), str)
            and _is_numbers(mark.get("position"), 3)
        ),
    )
    return Manifest(
        _text(path, values, "name"),
        _text(path, values, "licence") or _of_mesh(values, "licence"),
        _text(path, values, "provenance") or _of_mesh(values, "origin"),
        bool(values.get("generic", False)),
        _text(path, values, "shape_space"),
        joints,
        {n: (mark["bone"], _triple(mark["position"])) for n, mark in landmarks.items()},
        {n: (math.radians(low), math.radians(high)) for n, (low, high) in limits.items()},
        _of_mesh(values, "sha256"),
    )


def _require_degrees(path: Path, limits: Mapping[str, tuple[float, float]]) -> None:
    """Refuse limits the wrong way round; tell of such as are those of joints in radians."""
    for name, (low, high) in limits.items():
        if not low < high:
            raise InputError(
                f"{path}: [limits] {name} is {low:g} to {high:g} degrees; expected the lower end "
                "below the upper"
            )
    if limits and max(abs(end) for pair in limits.values() for end in pair) <= 2 * math.pi:
        _LOG.warning(
            "%s: no joint in [limits] may turn by more than 6 degrees; limits are in degrees, "
            "these look like radians",
            path,
        )


def _table(path: Path, values: Mapping[str, Any], key: str, fits: Any) -> dict[str, Any]:
    table = values.get(key, {})
    if not isinstance(table, dict) or not all(fits(value) for value in table.values()):
        raise InputError(f"{path}: [{key}] is not as perfcap writes it; build the actor again")
    return table


def _text(path: Path, values: Mapping[str, Any], key: str) -> str | None:
    value = values.get(key)
    if value is not None and not isinstance(value, str):
        raise InputError(f"{path}: {key} is {value!r:.40}; expected text")
    return value


def _of_mesh(values: Mapping[str, Any], key: str) -> str:
    """What the entry of the mesh's file says, as manifests of shipped models have it."""
    files = values.get("file")
    for entry in files if isinstance(files, list) else []:
        if isinstance(entry, dict) and entry.get("name") == MESH:
            return str(entry.get(key, UNKNOWN))
    return UNKNOWN


def _is_numbers(value: object, count: int) -> bool:
    return (
        isinstance(value, list)
        and len(value) == count
        and all(type(entry) in (int, float) and math.isfinite(entry) for entry in value)
    )
