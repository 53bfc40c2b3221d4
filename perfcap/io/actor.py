"""Actors by name or by file."""

from __future__ import annotations

import hashlib
import logging
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from perfcap.actor.actor import Actor
from perfcap.actor.bone_correction import unit_name
from perfcap.errors import InputError
from perfcap.io.actor_check import examine_actor, examine_joints, examine_weights
from perfcap.io.actor_folder import (
    UNKNOWN,
    Manifest,
    limited,
    load_actor_folder,
    read_manifest,
)
from perfcap.io.actor_import import import_actor, mapping_rows, read_mapping, require_sound
from perfcap.io.actor_place import MANIFEST, MESH
from perfcap.io.actor_points import limit_findings
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.gltf_document import companions, require_readable_kind
from perfcap.io.robot import is_robot, load_robot

_LOG = logging.getLogger(__name__)
_BARE = frozenset({".obj", ".ply", ".stl"})


@dataclass(frozen=True)
class ActorFile:
    """Where an actor is, and whether it stands for anybody rather than for one person."""

    path: Path
    generic: bool


def models_folder() -> Path:
    """The folder of shipped models: beside the package in a checkout, else where it is installed.

    Raises:
        InputError: neither is there.
    """
    places = (
        Path(__file__).resolve().parents[2] / "models",
        Path(sys.prefix) / "share" / "perfcap" / "models",
    )
    for place in places:
        if (place / "actors").is_dir():
            return place
    raise InputError(f"{places[0]}: the models folder is missing; install perfcap again")


def find_actor(name: str | Path) -> ActorFile:
    """A shipped actor by name, a ``.glb``/``.gltf`` file, or a folder that holds ``actor.glb``.

    Raises:
        InputError: there is no such actor, or it is FBX or the like, or a mesh without bones.
    """
    path = Path(name)
    if path.is_file():
        require_readable_kind(path)
        _require_character(path)
        return ActorFile(path, generic=False)
    folder = path if path.is_dir() else models_folder() / "actors" / path.name
    if not (folder / MESH).is_file() and (folder / "capture.glb").is_file():
        raise InputError(
            f"--actor {name}: holds a capture; give its {path / 'capture.glb'} for the person in it"
        )
    if not (folder / MESH).is_file():
        missing = f"holds no such file as {MESH}" if path.is_dir() else "no such file"
        known = sorted(p.parent.name for p in (models_folder() / "actors").glob(f"*/{MESH}"))
        raise InputError(
            f"--actor {name}: {missing}, and no shipped actor has that name; expected a skinned "
            f".glb, a folder with {MESH}, or one of {', '.join(known)}"
        )
    return ActorFile(folder / MESH, read_manifest(folder / MANIFEST).generic)


def actor_files(name: str | Path) -> tuple[Path, ...]:
    """The files that make an actor: its mesh, what this keeps beside it, and its manifest.

    Raises:
        InputError: there is no such actor; see ``find_actor``.
    """
    path = find_actor(name).path
    beside = [*companions(path), *([path.with_name(MANIFEST)] if path.name == MESH else [])]
    return (path, *(each for each in beside if each.is_file()))


def _require_character(path: Path) -> None:
    kind = path.suffix.lower()
    if kind in _BARE:
        raise InputError(
            f"--actor {path}: is a mesh without bones; perfcap actor build {path} --out FOLDER "
            "gives it some, and FOLDER is an actor"
        )
    if kind == ".bvh":
        raise InputError(
            f"--actor {path}: is a motion without a body; expected a skinned .glb (perfcap "
            "retarget puts the motion on one)"
        )


@dataclass(frozen=True, eq=False)
class Examination:
    """An actor and all there is to say about it.

    Attributes:
        path: its mesh.
        actor: the actor.
        manifest: what its folder or file says about it.
        convention: whose names the bones have.
        space: units and axes of its file.
        rows: joint or landmark, its bone, and how it was found.
        parts: name and number of vertices of the parts of the file.
        findings: what is odd or wrong.
    """

    path: Path
    actor: Actor
    manifest: Manifest
    convention: str
    space: str
    rows: tuple[tuple[str, str, str], ...]
    parts: tuple[tuple[str, int], ...]
    findings: tuple[Finding, ...]


def examine(name: str | Path, mapping: str | Path | None = None) -> Examination:
    """Look at an actor of any kind; see ``load_actor`` for the arguments.

    Raises:
        InputError: it cannot be read, or its joints cannot be found.
    """
    path = find_actor(name).path
    if is_robot(path):
        raise InputError(f"{path}: is a robot, which perfcap retarget takes; expected a character")
    manifest = _manifest(path)
    if mapping is None and manifest.joints:
        return _examine_built(path, manifest)
    imported = import_actor(path, None if mapping is None else read_mapping(Path(mapping)))
    rights = imported.character.copyright
    if manifest.licence == UNKNOWN and rights is not None:
        manifest = replace(manifest, licence=rights)
    template, correction = imported.actor.template, imported.correction
    unit = unit_name(correction.scale)
    actor = limited(imported.actor, manifest, path.parent)
    return Examination(
        path,
        actor,
        manifest,
        imported.bones.convention or "not known: joints were found by their places",
        f"in {unit}, {correction.up} up, facing {correction.ahead}",
        tuple(mapping_rows(template, imported.bones)),
        imported.character.parts,
        (*imported.findings, *limit_findings(actor.skeleton.rig)),
    )


def _examine_built(path: Path, manifest: Manifest) -> Examination:
    actor = load_actor_folder(path.parent)
    template, made = actor.template, "manifest"
    rows = [(n, template.bone_names[b], made) for n, b in template.joint_bones.items()]
    rows += [(name, "", made) for name in template.landmarks]
    limits = limit_findings(actor.skeleton.rig)
    return Examination(
        path,
        actor,
        manifest,
        made,
        "in metres, y up, facing z",
        tuple(rows),
        (),
        (*_about_files(path, manifest), *examine_actor(template), *limits),
    )


def load_actor(
    name: str | Path, mapping: str | Path | None = None, *, robots: bool = False
) -> Actor:
    """The actor of a name or file (see ``find_actor``), in float64.

    A character of another program may have any bones, units and axes: see ``import_actor``.

    Args:
        name: a shipped actor, a file or a folder.
        mapping: a file that names the bones of joints, where names and places do not tell.
        robots: whether a URDF or MJCF will do, whose skeleton is its own: see ``load_robot``.

    Raises:
        InputError: it cannot be read, has no skin, lacks joints of the skeleton, or has faults
            that would spoil a capture.
    """
    path = find_actor(name).path
    if is_robot(path):
        if not robots:
            raise InputError(
                f"--actor {name}: is a robot, whose joints are no person's; capture a person, then "
                "put the motion on it: perfcap retarget FOLDER --actor " + path.name
            )
        return load_robot(path, None if mapping is None else read_mapping(Path(mapping)))
    manifest = _manifest(path)
    if mapping is None and manifest.joints:
        actor = load_actor_folder(path.parent)
        about_file, about_actor = _about_files(path, manifest), examine_joints(actor.template)
    else:
        imported = import_actor(path, None if mapping is None else read_mapping(Path(mapping)))
        actor = limited(imported.actor, manifest, path.parent)
        about_file, about_actor = imported.about_file, imported.about_actor
    require_sound(path, (*about_file, *about_actor))
    # of folders, which were looked at as they were built, joints are not held against the mesh
    told = [each for each in about_actor if each.subject in ("limbs", "joints", "landmarks")]
    told += examine_weights(actor.template)
    for finding in (*about_file, *told, *limit_findings(actor.skeleton.rig)):
        if finding.severity is Severity.WARNING:
            _LOG.warning("%s: %s", path, finding)
    return actor


def _about_files(path: Path, manifest: Manifest) -> tuple[Finding, ...]:
    """Whether a mesh is the one that its manifest was written for."""
    with path.open("rb") as file:
        same = hashlib.file_digest(file, "sha256").hexdigest() == manifest.digest
    if same or manifest.digest == UNKNOWN:
        return ()
    what = f"is not the file that {MANIFEST} was written for (sha256)"
    remedy = f"joints and landmarks may be of another one: perfcap actor build {path.name} again"
    return (Finding(Severity.WARNING, "mesh", what, remedy),)


def _manifest(path: Path) -> Manifest:
    """The manifest beside an actor's mesh; of other files there is none."""
    return read_manifest(path.with_name(MANIFEST)) if path.name == MESH else Manifest()
