"""A rigged character of any program as an actor, by names or by a mapping file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS, PARENTS
from perfcap.actor.bone_correction import Correction, find_correction, unit_name
from perfcap.actor.bone_map import BoneMap, end_landmarks, map_bones
from perfcap.actor.bone_names import ENDS
from perfcap.actor.bone_owners import bone_owners
from perfcap.actor.template import Template
from perfcap.errors import InputError
from perfcap.io.actor_check import examine_actor
from perfcap.io.actor_layers import layer_findings
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.files import MEBIBYTE, read_toml
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_read import Character, read_character

# --- Mapping files: which of a rig's bones are which joints, where perfcap cannot tell ------------

_UNIT = "metres_per_unit"


@dataclass(frozen=True)
class ActorMapping:
    """What a user says about a rig.

    Attributes:
        joints: names of bones by joint or landmark.
        metres_per_unit: length of the file's unit, None to guess it from the height.
    """

    joints: Mapping[str, str] = field(default_factory=dict)
    metres_per_unit: float | None = None


def read_mapping(path: Path) -> ActorMapping:
    """Read lines such as ``pelvis = "Bip01 Pelvis"`` and ``metres_per_unit = 0.01``.

    Raises:
        InputError: the file is not TOML, or says something else.
    """
    values = read_toml(path, "a mapping file", MEBIBYTE)
    unit = values.pop(_UNIT, None)
    if unit is not None and not (
        isinstance(unit, float | int) and math.isfinite(unit) and 1e-6 < unit < 1e6
    ):
        raise InputError(f"{path}: {_UNIT} is {unit!r:.40}; expected metres, such as 0.01")
    for joint, bone in values.items():
        if joint not in (*JOINTS, *ENDS):
            known = ", ".join((*JOINTS, *ENDS, _UNIT))
            raise InputError(f"{path}: {joint!r:.40} is no joint; expected some of {known}")
        if not isinstance(bone, str):
            raise InputError(f"{path}: {joint} is {bone!r:.40}; expected the name of a bone")
    return ActorMapping(values, unit)


# --- A rigged character of any program as an actor, with all there is to say about it -------------


@dataclass(frozen=True, eq=False)
class ImportedActor:
    """An actor, where its joints were found, and what is odd about its file.

    Attributes:
        character: as the file has it.
        actor: in metres, y up, facing +z.
        bones: the joints' bones.
        correction: what took the file's coordinates to the actor's.
        about_file: what the import met and put right.
        about_actor: what is wrong with the mesh, its weights or its rest pose.
    """

    character: Character
    actor: Actor
    bones: BoneMap
    correction: Correction
    about_file: tuple[Finding, ...]
    about_actor: tuple[Finding, ...]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All there is to say."""
        return (*self.about_file, *self.about_actor)


def import_actor(path: str | Path, mapping: ActorMapping | None = None) -> ImportedActor:
    """Read a skinned ``.glb`` or ``.gltf`` with any bones, in any units, with any axis up.

    Raises:
        InputError: the file cannot be read, or its joints cannot be found.
    """
    return rig_character(read_character(open_document(Path(path))), mapping)


def rig_character(character: Character, mapping: ActorMapping | None = None) -> ImportedActor:
    """An actor of a character that has been read.

    Raises:
        InputError: joints, or the unit of the file, cannot be found.
    """
    mapping = mapping or ActorMapping()
    raw = character.template
    bones = map_bones(raw, mapping.joints)
    correction = find_correction(raw, bones.joints, mapping.metres_per_unit)
    template = with_joints(correction.apply(raw), bones)
    about_import = _about_import(raw, bones, correction)
    layers = layer_findings(template, character.parts)
    about_file = (*character.findings, *about_import, *layers)
    actor = Actor(template)
    return ImportedActor(character, actor, bones, correction, about_file, examine_actor(template))


def with_joints(template: Template, bones: BoneMap) -> Template:
    """A template in metres with the joints and landmarks of its bones."""
    order = list(PARENTS)
    own = {bone: order.index(name) for name, bone in bones.joints.items()}
    above = [-1 if parent is None else order.index(parent) for parent in PARENTS.values()]
    parents, places = template.bone_parents.tolist(), template.bone_rest[:, :3, 3]
    landmarks = end_landmarks(template, bones, bone_owners(parents, places, own, above))
    return replace(template, joint_bones=bones.joints, landmarks=landmarks)


def require_sound(path: Path | str, findings: tuple[Finding, ...]) -> None:
    """Refuse an actor that would spoil a capture.

    Raises:
        InputError: one of the findings is an error.
    """
    for finding in findings:
        if finding.severity is Severity.ERROR:
            remedy = f"; {finding.remedy}" if finding.remedy else ""
            raise InputError(f"{path}: {finding.subject}: {finding.what}{remedy}")


def _about_import(raw: Template, bones: BoneMap, correction: Correction) -> list[Finding]:
    """What the import had to put right."""
    found = []

    def warn(subject: str, what: str, remedy: str) -> None:
        found.append(Finding(Severity.WARNING, subject, what, remedy))

    if correction.scale != 1.0:
        unit = unit_name(correction.scale)
        remedy = f"it was scaled by {correction.scale:g}; animations are written in {unit} again"
        warn("scale", f"the file is in {unit}, not in metres", remedy)
    if correction.up != "y":
        remedy = "it was turned upright; animations are written in the file's axes again"
        warn("axes", f"{correction.up} is up, not y", remedy)
    elif correction.ahead != "z":
        warn("axes", f"the person faces {correction.ahead}, not z", "it was turned around")
    if bones.swapped:
        what = "bones named left are on the right of where the feet point"
        warn("left and right", what, "they were exchanged; mirror the names in Blender")
    return found


def mapping_rows(template: Template, bones: BoneMap) -> list[tuple[str, str, str]]:
    """Joint or landmark, bone and how it was found, for people."""
    names: Mapping[str, int] = {**bones.joints, **bones.ends}
    rows = [
        (joint, template.bone_names[bone], bones.sources.get(joint, "name"))
        for joint, bone in names.items()
    ]
    known = {row[0] for row in rows}
    return rows + [(name, "", "skin") for name in template.landmarks if name not in known]
