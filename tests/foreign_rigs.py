"""Characters as other programs rig them: foreign names, units and axes, and any number of bones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from synthetic import rest_positions, template

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_space import BoneSpace
from perfcap.actor.template import Template
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_write import save_animation

Floats = np.ndarray

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # facing -y, as Blender has it


def sided(left: str, right: str, **parts: str) -> dict[str, str]:
    """Names of both sides: ``{}`` in a part's name stands for the side."""
    return {
        f"{side}_{joint}": name.format(word)
        for side, word in (("l", left), ("r", right))
        for joint, name in parts.items()
    }


MIXAMO = {
    "pelvis": "mixamorig:Hips", "spine": "mixamorig:Spine2", "neck": "mixamorig:Neck",
    "head": "mixamorig:Head",
    **sided("Left", "Right", shoulder="mixamorig:{}Arm", elbow="mixamorig:{}ForeArm",
            wrist="mixamorig:{}Hand", hip="mixamorig:{}UpLeg", knee="mixamorig:{}Leg",
            ankle="mixamorig:{}Foot"),
}  # fmt: skip
BIPED = {
    "pelvis": "Bip01 Pelvis", "spine": "Bip01 Spine1", "neck": "Bip01 Neck", "head": "Bip01 Head",
    **sided("L", "R", shoulder="Bip01 {} UpperArm", elbow="Bip01 {} Forearm",
            wrist="Bip01 {} Hand", hip="Bip01 {} Thigh", knee="Bip01 {} Calf",
            ankle="Bip01 {} Foot"),
}  # fmt: skip
UNREAL = {
    "pelvis": "pelvis", "spine": "spine_02", "neck": "neck_01", "head": "head",
    **sided("l", "r", shoulder="upperarm_{}", elbow="lowerarm_{}", wrist="hand_{}", hip="thigh_{}",
            knee="calf_{}", ankle="foot_{}"),
}  # fmt: skip
VRM = {
    "pelvis": "J_Bip_C_Hips", "spine": "J_Bip_C_Chest", "neck": "J_Bip_C_Neck",
    "head": "J_Bip_C_Head",
    **sided("L", "R", shoulder="J_Bip_{}_UpperArm", elbow="J_Bip_{}_LowerArm",
            wrist="J_Bip_{}_Hand", hip="J_Bip_{}_UpperLeg", knee="J_Bip_{}_LowerLeg",
            ankle="J_Bip_{}_Foot"),
}  # fmt: skip
RIGIFY = {
    "pelvis": "DEF-spine", "spine": "DEF-spine.003", "neck": "DEF-spine.004",
    "head": "DEF-spine.006",
    **sided("L", "R", shoulder="DEF-upper_arm.{}", elbow="DEF-forearm.{}", wrist="DEF-hand.{}",
            hip="DEF-thigh.{}", knee="DEF-shin.{}", ankle="DEF-foot.{}"),
}  # fmt: skip
NAMELESS = {joint: f"bone_{(7 * number) % 23}" for number, joint in enumerate(JOINTS)}


def person() -> Template:
    """The person of tubes with hands, its bones called like the joints, without landmarks."""
    plain = template()
    vertices, faces = [*plain.vertices], [*plain.faces]
    bones, weights = [*plain.weight_bones], [*plain.weights]
    at = {name: place.numpy() for name, place in rest_positions().items()}
    for side in "lr":
        wrist = at[f"{side}_wrist"]
        along = wrist - at[f"{side}_elbow"]
        tip = wrist + 0.18 * along / np.linalg.norm(along)
        start = len(vertices)
        palm = wrist + np.array([[0, 0.03, 0], [0, -0.03, 0], [0, 0, 0.04]])
        vertices += [*palm, tip]
        faces += [np.array(f) + start for f in ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1))]
        hand = np.array([JOINTS.index(f"{side}_wrist"), 0, 0, 0])
        bones += [hand] * 4
        weights += [np.array([1.0, 0, 0, 0])] * 4
    return replace(
        plain,
        vertices=np.array(vertices),
        faces=np.array(faces),
        weight_bones=np.array(bones),
        weights=np.array(weights),
        landmarks={},
    )


@dataclass(frozen=True)
class Rig:
    """How a program rigs the person.

    Attributes:
        names: of the joints' bones.
        unit: metres per unit of the file.
        turn: from the actor's axes to the file's, (3, 3).
        armature: whether a node above the bones holds unit and turn, as it should.
        root: name of a bone on the ground above the pelvis.
        spines: names of more bones between pelvis and chest.
        extra: further bones: fingers, twists and faces.
        loose: joints whose bones hang on nothing.
        collar: what bones between the chest and the arms are called, before their side.
    """

    names: Mapping[str, str]
    unit: float = 1.0
    turn: Floats = field(default_factory=lambda: np.eye(3))
    armature: bool = False
    root: str | None = None
    spines: tuple[str, ...] = ()
    extra: int = 0
    loose: tuple[str, ...] = ()
    collar: str | None = None

    def template(self) -> Template:
        """The person so rigged, in metres; the armature's unit and turn are in its space."""
        plain = _renamed(_with_extra(_between(person(), self), self), self)
        linear = self.unit * self.turn.T
        if not self.armature:
            return plain
        frame = np.eye(4)
        frame[:3, :3] = linear
        units = np.full(len(plain.bone_names), self.unit)
        return replace(plain, space=BoneSpace(units, frame))

    def write(self, path: Path) -> Template:
        """Write it as a file; returns what the file holds, in metres and upright."""
        made = self.template()
        raw = made if self.armature else transformed(made, self.turn / self.unit, np.zeros(3))
        still = np.tile(np.eye(4), (1, len(raw.bone_names), 1, 1))
        save_animation(path, raw, still, 30)
        return made


RIGS = {
    "Mixamo, centimetres, armature": Rig(
        MIXAMO, 0.01, armature=True, spines=("mixamorig:Spine", "mixamorig:Spine1")
    ),
    "Biped, centimetres, z up": Rig(BIPED, 0.01, Z_UP, root="Bip01", spines=("Bip01 Spine",)),
    "Unreal, 150 bones": Rig(UNREAL, root="root", spines=("spine_01",), extra=132),
    "no names, inches, z up": Rig(NAMELESS, 0.0254, Z_UP, spines=("bone_40", "bone_41")),
    "Rigify, loose limbs, z up armature": Rig(
        RIGIFY, 1.0, Z_UP, armature=True, loose=("l_shoulder", "r_shoulder", "l_hip", "r_hip")
    ),
    "VRM, facing back": Rig(VRM, 1.0, np.diag([-1.0, 1, -1]), root="Root"),
}


def transformed(template: Template, linear: Floats, offset: Floats) -> Template:
    """The template with its coordinates scaled, turned and moved, like a file that lies."""
    rest = template.bone_rest.copy()
    size = np.cbrt(np.linalg.det(linear))
    rest[:, :3, :3] = linear / size @ rest[:, :3, :3]
    rest[:, :3, 3] = rest[:, :3, 3] @ linear.T + offset
    return replace(template, vertices=template.vertices @ linear.T + offset, bone_rest=rest)


def _between(template: Template, rig: Rig) -> Template:
    """Bones above the pelvis and between it and the chest."""
    names, parents = list(template.bone_names), template.bone_parents.tolist()
    rest = list(template.bone_rest)
    chest, pelvis = names.index("spine"), names.index("pelvis")
    above = pelvis
    for number, name in enumerate(rig.spines):
        share = (number + 1) / (len(rig.spines) + 1)
        place = rest[pelvis].copy()
        place[:3, 3] += share * (rest[chest][:3, 3] - rest[pelvis][:3, 3])
        names, parents, rest = [*names, name], [*parents, above], [*rest, place]
        above = len(names) - 1
    parents[chest] = above
    if rig.root is not None:
        names, parents, rest = [*names, rig.root], [*parents, -1], [*rest, np.eye(4)]
        parents[pelvis] = len(names) - 1
    for side in "lr" if rig.collar else "":
        arm = names.index(f"{side}_shoulder")
        place = rest[arm].copy()
        place[0, 3] *= 0.4
        names, parents = [*names, f"{rig.collar}.{side}"], [*parents, parents[arm]]
        rest, parents[arm] = [*rest, place], len(names) - 1
    for joint in rig.loose:
        parents[names.index(joint)] = -1
    return _sorted(template, names, parents, rest)


def _sorted(
    template: Template, names: list[str], parents: list[int], rest: list[Floats]
) -> Template:
    order: list[int] = []
    while len(order) < len(names):
        order += [b for b in range(len(names)) if b not in order and parents[b] in (-1, *order)]
    index = np.argsort(order)
    return replace(
        template,
        bone_names=tuple(names[b] for b in order),
        bone_parents=np.array([-1 if parents[b] < 0 else index[parents[b]] for b in order]),
        bone_rest=np.array([rest[b] for b in order]),
        weight_bones=index[template.weight_bones],
    )


def _with_extra(template: Template, rig: Rig) -> Template:
    """Chains of two bones on hands, head, limbs and chest, that take a share of the skin."""
    rng = np.random.default_rng(0)
    hosts = [n for n in JOINTS if n not in ("pelvis", "neck")]
    names, parents = list(template.bone_names), template.bone_parents.tolist()
    rest, weight_bones = list(template.bone_rest), template.weight_bones.copy()
    for number in range(rig.extra):
        chained = number % 2 == 1
        host = len(names) - 1 if chained else names.index(hosts[number // 2 % len(hosts)])
        place = rest[host].copy()
        place[:3, 3] += rng.normal(0, 0.02, 3)
        names, parents, rest = [*names, f"helper_{number}"], [*parents, host], [*rest, place]
        mine = np.flatnonzero(weight_bones[:, 0] == host)
        weight_bones[mine[:2], 0] = len(names) - 1
    return replace(
        template,
        bone_names=tuple(names),
        bone_parents=np.array(parents),
        bone_rest=np.array(rest),
        weight_bones=weight_bones,
    )


def _renamed(template: Template, rig: Rig) -> Template:
    """Foreign names, and axes of the bones that point anywhere."""
    rest = template.bone_rest.copy()
    turns = Rotation.random(len(rest), rng=np.random.default_rng(1)).as_matrix()
    rest[:, :3, :3] = turns
    names = tuple(rig.names.get(name, name) for name in template.bone_names)
    return replace(template, bone_names=names, bone_rest=rest, name="foreign").rounded()


def played_on(own: Path, capture: Path, frame: int, rate: float) -> Floats:
    """Vertices of a file in its own world, (V, 3), moved by another file's animation.

    Channels are taken over by the names of the nodes, as animation programs do; the rules are
    those of the specification, and nothing of perfcap's writer is used.
    """
    document, source = open_document(own), open_document(capture)
    nodes = [dict(node) for node in document.tree["nodes"]]
    by_name = {node["name"]: node for node in nodes}
    animation = source.tree["animations"][0]
    for channel in animation["channels"]:
        path = channel["target"]["path"]
        if path == "weights":
            continue
        sampler = animation["samplers"][channel["sampler"]]
        keys = source.accessor(sampler["input"], "SCALAR")[:, 0]
        row = int(np.abs(keys - frame / rate).argmin())
        values = source.accessor(sampler["output"], "VEC4" if path == "rotation" else "VEC3")
        name = source.tree["nodes"][channel["target"]["node"]]["name"]
        by_name[name][path] = values[row]
    world: dict[int, Floats] = {}

    def visit(number: int, above: Floats) -> None:
        node, local = nodes[number], np.eye(4)
        local[:3, :3] = Rotation.from_quat(node.get("rotation", (0, 0, 0, 1))).as_matrix()
        local[:3, :3] *= node.get("scale", (1, 1, 1))
        local[:3, 3] = node.get("translation", (0, 0, 0))
        world[number] = above @ local
        for child in node.get("children", []):
            visit(child, world[number])

    for root in document.tree["scenes"][0]["nodes"]:
        visit(root, np.eye(4))
    skin = document.tree["skins"][0]
    attributes = document.tree["meshes"][0]["primitives"][0]["attributes"]
    inverse = document.accessor(skin["inverseBindMatrices"], "MAT4").reshape(-1, 4, 4).mT
    matrices = np.stack([world[joint] for joint in skin["joints"]]) @ inverse
    bones = document.accessor(attributes["JOINTS_0"], "VEC4")
    weights = document.accessor(attributes["WEIGHTS_0"], "VEC4")
    points = np.c_[document.accessor(attributes["POSITION"], "VEC3"), np.ones(len(bones))]
    moved: Floats = np.einsum("vk,vkij,vj->vi", weights, matrices[bones], points)[:, :3]
    return moved
