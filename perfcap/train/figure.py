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


# --- Skirts and coats: cloth that hangs around hips and legs --------------------------------------
#
# Nothing is simulated. Around the axis of the pelvis, at every height, cloth is as wide as the legs
# there push it, and never narrower than above: it falls straight from the widest place.

Floats = NDArray[np.float32]

_AROUND, _DOWN = 48, 14  # vertices around and down
_CLEARANCE = 0.012  # m between body and cloth
_BODY = tuple(
    JOINTS.index(n)
    for n in ("pelvis", "l_hip", "r_hip", "l_knee", "r_knee")
)  # fmt: skip


@dataclass(frozen=True)
class Skirt:
    """A cut.

    Attributes:
        rise: of its waist above the middle of the hips, m.
        length: from the waist down, m.
        flare: how much wider it gets, m a metre.
        folds: how many.
        depth: of the folds at the hem, m.
        phase: of the folds, rad.
        sway: of the hem, ahead and to the left, m.
    """

    rise: float
    length: float
    flare: float
    folds: int
    depth: float
    phase: float
    sway: tuple[float, float]


def random_skirt(rng: np.random.Generator) -> Skirt:
    """From mini to floor length, from pencil to circle."""
    return Skirt(
        rise=float(rng.uniform(0.0, 0.18)),
        length=float(rng.uniform(0.4, 1.0)),
        flare=float(rng.uniform(0.0, 0.32)),
        folds=int(rng.integers(4, 13)),
        depth=float(rng.uniform(0.0, 0.045)),
        phase=float(rng.uniform(0, 6.3)),
        sway=(float(rng.normal(0, 0.04)), float(rng.normal(0, 0.04))),
    )


def hang(skirt: Skirt, figure: Figure, surface: Tensor, hips: Tensor, turn: Tensor) -> Tensor:
    """Vertices (K, 3) of a skirt on a posed figure, row by row from the waist down.

    Args:
        skirt: its cut.
        figure: who wears it.
        surface: posed vertices (V, 3), world, m.
        hips: the middle of the hips, (3,).
        turn: of the pelvis in the world, (3, 3).
    """
    worn = torch.isin(figure.owner, torch.tensor(_BODY))
    local = ((surface[worn] - hips) @ turn).numpy()  # x left, y up, z ahead of the pelvis
    radius = _radii(local, skirt)
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    down = np.linspace(0, 1, _DOWN)[:, None]
    radius += skirt.flare * skirt.length * down
    radius += skirt.depth * down * np.sin(skirt.folds * angle + skirt.phase)
    x = radius * np.cos(angle) + skirt.sway[1] * down**2
    z = radius * np.sin(angle) + skirt.sway[0] * down**2
    y = np.broadcast_to(skirt.rise - skirt.length * down, x.shape)
    points = torch.from_numpy(np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32))
    return points @ turn.T + hips


def skirt_mesh() -> tuple[Tensor, Tensor]:
    """Faces (T, 3) and texture places (K, 2) of any skirt; the texture runs around and down."""
    row, column = (v.ravel() for v in np.mgrid[: _DOWN - 1, :_AROUND])
    right = (column + 1) % _AROUND
    a, b = row * _AROUND + column, row * _AROUND + right
    c, d = a + _AROUND, b + _AROUND
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    down, around = np.divmod(np.arange(_DOWN * _AROUND), _AROUND)
    # there and back again, so that the texture has no seam
    across = 1 - np.abs(2 * around / _AROUND - 1)
    uv = np.stack([across, down / (_DOWN - 1)], -1).astype(np.float32)
    return torch.from_numpy(faces), torch.from_numpy(uv)


def skirt_ahead() -> Tensor:
    """Faces (T,) that are before the wearer."""
    before = torch.arange(_AROUND) < _AROUND // 2
    return before.repeat(_DOWN - 1).repeat(2)


def _radii(local: Floats, skirt: Skirt) -> NDArray[np.float64]:
    """How far legs push cloth at each height and in each direction, (down, around), m."""
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    out = np.stack([np.cos(angle), np.sin(angle)])
    reach = local[:, [0, 2]] @ out
    level = (skirt.rise - local[:, 1]) / skirt.length * (_DOWN - 1)
    radius = np.full((_DOWN, _AROUND), 0.06)
    for row in range(_DOWN):
        here = np.abs(level - row) < 1
        if here.any():
            radius[row] = np.maximum(radius[row], reach[here].max(0) + _CLEARANCE)
    widest: NDArray[np.float64] = np.maximum.accumulate(radius, 0)
    return widest
