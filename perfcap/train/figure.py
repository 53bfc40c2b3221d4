"""People to draw: a mesh that bends, joints that turn it, a texture that can be repainted."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS, PARENTS
from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import dual_quaternion_blend
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.train.motion_library import STRAIGHT, smallest_turn

_PARENT = [-1 if p is None else JOINTS.index(p) for p in PARENTS.values()]
_CARRIER = {"head_top": "head", "r_toe": "r_ankle", "l_toe": "l_ankle"}
_CARRIERS = [JOINTS.index(_CARRIER.get(name, name)) for name in LANDMARKS]
_ENDS = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle", "ankle": "toe"}


@dataclass(frozen=True, eq=False)
class Figure:
    """A person at rest, without texture seams in the mesh; all float32.

    Attributes:
        vertices: (V, 3) m, y up, facing +z.
        faces: (T, 3).
        skin: weights of the joints.
        joints: rest positions in the order of ``JOINTS``, (16, 3) m.
        landmarks: rest positions, (16, 3) m.
        owner: joint of the largest weight of each vertex, (V,).
        uv: corners of the texture, (N, 2).
        faces_uv: those of each face, (T, 3).
        texture: sRGB picture (h, w, 3) uint8.
    """

    vertices: Tensor
    faces: Tensor
    skin: SkinWeights
    joints: Tensor
    landmarks: Tensor
    owner: Tensor
    uv: Tensor
    faces_uv: Tensor
    texture: NDArray[np.uint8]


def actor_figure(actor: Actor, side: int) -> Figure:
    """An actor with its own texture, at most ``side`` pixels wide; grey without one.

    Raises:
        InputError: its texture cannot be decoded.
    """
    template = actor.template
    welded, first = template.weld()
    names = actor.skeleton.rig.joints
    own = actor.skeleton.rig.without_clavicles
    order = torch.tensor([JOINTS.index(names[joint]) for joint in own])
    bones = order[torch.tensor(actor.bone_joints)[torch.tensor(template.weight_bones[first])]]
    weights = torch.tensor(template.weights[first], dtype=torch.float32)
    faces = torch.tensor(template.faces)
    uv = np.zeros((len(template.vertices), 2)) if template.uv is None else template.uv
    rest = {name: actor.skeleton.rest_positions[names.index(name)] for name in JOINTS}
    marks = dict(zip(LANDMARKS, actor.skeleton.rest_landmarks, strict=True))
    return Figure(
        vertices=torch.tensor(template.vertices[first], dtype=torch.float32),
        faces=torch.from_numpy(welded)[faces],
        skin=SkinWeights(weights, bones),
        joints=torch.stack([rest[name] for name in JOINTS]).float(),
        landmarks=torch.stack([marks[name] for name in LANDMARKS]).float(),
        owner=bones.gather(1, weights.argmax(1, keepdim=True)).squeeze(1),
        uv=torch.tensor(uv, dtype=torch.float32),
        faces_uv=faces,
        texture=_picture(template.texture, side, template.name),
    )


def rest_turns(figure: Figure) -> Tensor:
    """Turns (16, 3, 3) that take the bones of a figure's rest pose to those of a T-pose."""
    at = dict(zip(LANDMARKS, figure.landmarks.double().numpy(), strict=True))
    turns = np.tile(np.eye(3), (len(JOINTS), 1, 1))
    for row, joint in enumerate(JOINTS):
        side, _, bare = joint.partition("_")
        start = f"{side}_elbow" if bare == "wrist" else joint  # hands go on as forearms do
        if joint in STRAIGHT:
            bone = at[f"{side}_{_ENDS[start.partition('_')[2]]}"] - at[start]
            turns[row] = smallest_turn(bone, np.array(STRAIGHT[joint]))
    return torch.from_numpy(turns.astype(np.float32))


def pose_figure(
    figure: Figure, vertices: Tensor, turns: Tensor, rest: Tensor
) -> tuple[Tensor, Tensor]:
    """A figure in a recorded pose, its pelvis over the origin.

    Args:
        figure: who.
        vertices: rest surface (V, 3); the figure's, or dressed.
        turns: of the joints against a T-pose, world, (16, 3, 3), as ``Recording.turns``.
        rest: ``rest_turns`` of the figure.

    Returns:
        Vertices (V, 3) and landmarks (16, 3), metres.
    """
    rotation = turns @ rest
    places = [torch.zeros(3)]
    for joint, parent in enumerate(_PARENT[1:], start=1):
        bone = figure.joints[joint] - figure.joints[parent]
        places.append(places[parent] + rotation[parent] @ bone)
    position = torch.stack(places)
    offset = position - (rotation @ figure.joints[..., None]).squeeze(-1)
    surface = dual_quaternion_blend(vertices, figure.skin, rotation[None], offset[None])[0]
    carried = rotation[_CARRIERS] @ figure.landmarks[..., None]
    return surface, carried.squeeze(-1) + offset[_CARRIERS]


def _picture(data: bytes | None, side: int, name: str) -> NDArray[np.uint8]:
    if data is None:
        return np.full((8, 8, 3), 150, np.uint8)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise InputError(f"actor {name!r}: its texture is no JPEG or PNG; give it another one")
    scale = min(1.0, side / max(image.shape[:2]))
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)
