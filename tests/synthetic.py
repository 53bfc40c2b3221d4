"""A small synthetic person, its motions and its cameras; noiseless, in float64."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS, PARENTS
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.actor.template import Template
from perfcap.geometry.camera import Camera

RING = 6  # vertices around a limb

# Where each joint's part of the mesh ends, and how thick it is, metres.
_LIMBS = {
    "pelvis": ("spine", 0.14),
    "spine": ("neck", 0.14),
    "neck": ("head", 0.05),
    "head": ("head_top", 0.09),
    **{f"{s}_shoulder": (f"{s}_elbow", 0.045) for s in "lr"},
    **{f"{s}_elbow": (f"{s}_wrist", 0.035) for s in "lr"},
    **{f"{s}_hip": (f"{s}_knee", 0.075) for s in "lr"},
    **{f"{s}_knee": (f"{s}_ankle", 0.05) for s in "lr"},
    **{f"{s}_ankle": (f"{s}_toe", 0.04) for s in "lr"},
}


def rest_positions(
    arms: float = 45.0, elbows: float = 12.0, knees: float = 6.0
) -> dict[str, Tensor]:
    """Rest joints and landmarks of a 1.75 m adult, metres, y up, facing +z, left is +x.

    Args:
        arms: degrees between the upper arm and straight down; 45 an A-pose, 90 a T-pose.
        elbows: flexion of the elbows in degrees, forwards.
        knees: flexion of the knees in degrees.
    """
    lift, bend, knee = (math.radians(value) for value in (arms, elbows, knees))
    place = {
        "pelvis": (0.0, 0.96, 0.0),
        "spine": (0.0, 1.10, -0.01),
        "neck": (0.0, 1.45, -0.02),
        "head": (0.0, 1.55, 0.01),
        "head_top": (0.0, 1.75, 0.01),
        "l_shoulder": (0.19, 1.41, -0.02),
        "l_hip": (0.09, 0.92, 0.0),
    }
    at = {name: torch.tensor(value, dtype=torch.float64) for name, value in place.items()}
    upper = torch.tensor([math.sin(lift), -math.cos(lift), 0.0], dtype=torch.float64)
    ahead = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    at["l_elbow"] = at["l_shoulder"] + 0.29 * upper
    at["l_wrist"] = at["l_elbow"] + 0.25 * (math.cos(bend) * upper + math.sin(bend) * ahead)
    down = -torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    thigh = math.cos(knee / 2) * down + math.sin(knee / 2) * ahead
    shank = math.cos(knee / 2) * down - math.sin(knee / 2) * ahead
    at["l_knee"] = at["l_hip"] + 0.42 * thigh
    at["l_ankle"] = at["l_knee"] + 0.41 * shank
    at["l_toe"] = at["l_ankle"] + torch.tensor([0.02, -0.06, 0.16], dtype=torch.float64)
    return at | {f"r_{name[2:]}": mirror(value) for name, value in at.items() if name[:2] == "l_"}


def mirror(points: Tensor) -> Tensor:
    """Points (..., 3) seen in the mirror x = 0."""
    return points * points.new_tensor([-1.0, 1.0, 1.0])


def template(positions: dict[str, Tensor] | None = None) -> Template:
    """A person of tubes, blended at the joints; bones are the 16 joints."""
    at = {k: v.numpy() for k, v in (positions or rest_positions()).items()}
    vertices, faces, bones, weights = [], [], [], []
    for bone, (end, radius) in _LIMBS.items():
        joint = JOINTS.index(bone)
        parent = JOINTS.index(PARENTS[bone] or bone)
        for share, ring in ((0.5, 0.0), (1.0, 0.35), (1.0, 0.65), (1.0, 1.0)):
            if ring > 0:
                faces += _band(len(vertices))
            vertices += list(_ring(at[bone], at[end], ring, radius))
            bones += [(joint, parent)] * RING
            weights += [(share, 1 - share)] * RING
    rest = np.tile(np.eye(4), (len(JOINTS), 1, 1))
    rest[:, :3, 3] = [at[name] for name in JOINTS]
    ends = {"head_top": "head", "l_toe": "l_ankle", "r_toe": "r_ankle"}
    return Template(
        vertices=np.array(vertices),
        faces=np.array(faces),
        bone_names=JOINTS,
        bone_parents=np.array([-1 if p is None else JOINTS.index(p) for p in PARENTS.values()]),
        bone_rest=rest,
        weight_bones=np.array(bones),
        weights=np.array(weights),
        name="tubes",
        landmarks={name: (JOINTS.index(bone), at[name]) for name, bone in ends.items()},
    )


def _ring(start: np.ndarray, end: np.ndarray, along: float, radius: float) -> np.ndarray:
    """Points around the way from start to end."""
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    turn = 2 * np.pi * np.arange(RING)[:, None] / RING
    around = np.cos(turn) * side + np.sin(turn) * np.cross(axis, side)
    return start + along * (end - start) + radius * around


def _band(first: int) -> list[tuple[int, int, int]]:
    """Triangles between the ring before vertex ``first`` and the ring that starts there."""
    faces = []
    for i in range(RING):
        a, b = first - RING + i, first - RING + (i + 1) % RING
        faces += [(a, b, a + RING), (b, b + RING, a + RING)]
    return faces


def actor(positions: dict[str, Tensor] | None = None) -> Actor:
    """The person as a module, float64."""
    return Actor(template(positions))


def clavicled(plain: Template | None = None) -> Template:
    """The person of tubes on a rig with clavicles, which move half of where arms begin."""
    plain = plain or template()
    names = list(plain.bone_names)
    for side in "lr":
        names.insert(names.index(f"{side}_shoulder"), f"{side}_collar")
    old = {name: plain.bone_names.index(name) for name in plain.bone_names}
    rest = np.tile(np.eye(4), (len(names), 1, 1))
    for bone, name in enumerate(names):
        if name in old:
            rest[bone] = plain.bone_rest[old[name]]
        else:
            rest[bone, :3, 3] = (0.03 if name[0] == "l" else -0.03, 1.40, 0.03)
    parents = {"l_collar": "spine", "r_collar": "spine", **PARENTS}
    parents |= {f"{side}_shoulder": f"{side}_collar" for side in "lr"}
    bones = np.array([names.index(name) for name in plain.bone_names])[plain.weight_bones]
    for side in "lr":
        spine = bones == names.index("spine")
        arm = (bones == names.index(f"{side}_shoulder")).any(1, keepdims=True)
        bones = np.where(spine & arm, names.index(f"{side}_collar"), bones)
    return replace(
        plain,
        bone_names=tuple(names),
        bone_parents=np.array([-1 if (p := parents[n]) is None else names.index(p) for n in names]),
        bone_rest=rest,
        weight_bones=bones,
        landmarks={
            name: (names.index(plain.bone_names[bone]), place)
            for name, (bone, place) in plain.landmarks.items()
        },
        joint_bones={name: names.index(name) for name in JOINTS},
    )


def random_motion(
    skeleton: Skeleton,
    frames: int = 4,
    batch: tuple[int, ...] = (),
    *,
    bones: bool = False,
    seed: int = 0,
) -> Motion:
    """Poses anywhere within the limits, near the origin, turned any way."""
    random = torch.Generator().manual_seed(seed)
    lower, upper = skeleton.lower, skeleton.upper

    def uniform(*size: int) -> Tensor:
        return torch.rand(*size, generator=random, dtype=lower.dtype)

    groups = len(skeleton.group_names)
    return Motion(
        translation=uniform(*batch, frames, 3) - 0.5,
        rotation=3 * (uniform(*batch, frames, 3) - 0.5),
        angles=lower + (upper - lower) * uniform(*batch, frames, len(lower)),
        shared={"bones": 0.4 * (uniform(*batch, groups) - 0.5)} if bones else {},
    )


def bent_motion(
    skeleton: Skeleton, frames: int = 2, batch: tuple[int, ...] = (), *, seed: int = 0
) -> Motion:
    """Poses up to 0.6 rad around a relaxed one, whatever the limits are, turned any way."""
    random = torch.Generator().manual_seed(seed)

    def spread(size: int) -> Tensor:
        return 2 * torch.rand(*batch, frames, size, generator=random, dtype=torch.float64) - 1

    bends = [0.25 if n.endswith(("elbow_flexion", "knee_flexion")) else 0.0
             for n in skeleton.angle_names]  # fmt: skip
    angles = torch.tensor(bends, dtype=torch.float64) + 0.6 * spread(len(bends))
    place, turn = 0.5 * spread(3), 1.5 * spread(3)
    return Motion(place, turn, angles.clamp(skeleton.lower, skeleton.upper))


def cameras(views: int = 1, size: int = 400, distance: float = 5.0) -> Camera:
    """Views on a circle around the origin at height 0, looking at it."""
    turn = 2 * math.pi * torch.arange(views, dtype=torch.float64) / views
    zero, one = torch.zeros_like(turn), torch.ones_like(turn)
    # image y points down the world's y
    rows = (turn.cos(), zero, -turn.sin(), zero, -one, zero, -turn.sin(), zero, -turn.cos())
    intrinsics = torch.tensor(
        [[size, 0.0, size / 2], [0.0, size, size / 2], [0.0, 0.0, 1.0]], dtype=torch.float64
    )
    return Camera(
        intrinsics=intrinsics.repeat(views, 1, 1),
        rotation=torch.stack(rows, -1).reshape(views, 3, 3),
        translation=torch.tensor([0.0, 0.0, distance], dtype=torch.float64).repeat(views, 1),
        size=((size, size),) * views,
    )
