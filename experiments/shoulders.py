"""Shoulders that rise with the arms: the surface around them, still or with clavicles that turn.

The truth is MakeHuman's body on all 163 bones of its own rig, with the trunk and the limbs of
recorded people (Bandai Namco), whose skeleton has shoulder bones: its clavicles point at the
recorded places of the shoulders. `perfcap retarget` puts the joints of that truth on the same body
again, and a capture finds it from exact detections in four views. Errors are of the vertices within
16 cm of a shoulder, by the elevation of the arm. Expect 30 % less above 90 degrees.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import torch
from detection_noise import Noise
from fast_motion import around, observed
from makehuman_rigs import build, rigs
from numpy.typing import NDArray
from report import DATA, Report, Table, data_folder, main
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_owners import clavicle_bones
from perfcap.actor.motion import Motion
from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import dual_quaternion_blend
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.actor_import import import_actor
from perfcap.io.gltf_write import save_animation
from perfcap.io.moving_rig import MovingRig, read_moving_rig
from perfcap.pipeline.camera_path import orbit
from perfcap.pipeline.free_view import draw_free_view
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.joint_motion import (
    JointMotion,
    carried_landmarks,
    leg_length,
    unit_vectors,
    wanted_turns,
)
from perfcap.pipeline.retargeting import retarget
from perfcap.pipeline.surface import StoredSurface
from perfcap.pipeline.surroundings import Surroundings

CLIPS = ("dance-short", "kick", "bow", "call")
BANDS = ((0, 60), (60, 90), (90, 120), (120, 180), (90, 180))  # degrees of elevation
NEUTRAL, NEUTRAL_FRAMES = 45.0, 50  # degrees: the body's A-pose, in which shoulders rest
NEAR = 0.16  # m
SIZE = (700, 500)
SPINE = JOINTS.index("spine")


@dataclass(frozen=True)
class Experiment:
    """Which data."""

    data: Path = DATA
    """Folder of the recordings and of the MakeHuman assets."""
    every: int = 4
    """Frames from one to the next."""
    frames: int = 2000
    """At most, of each clip."""
    pictures: Path | None = None
    """Draw the highest arm of each clip into this folder: truth, then still and turning shoulders,
    retargeted, then captured."""


@dataclass(frozen=True)
class Truth:
    """A body posed on its whole rig.

    Attributes:
        joints: the sixteen of the skeleton, (F,).
        surface: (F, V, 3), metres.
        elevation: of the left and the right arm, (F, 2), degrees.
    """

    joints: JointMotion
    surface: Tensor
    elevation: NDArray[np.float64]


@dataclass
class Apart:
    """Distances of arms, mm, with their elevation, degrees; a list entry a clip and side."""

    surface: list[tuple[NDArray[np.float64], Tensor]] = field(default_factory=list)
    shoulder: list[tuple[NDArray[np.float64], Tensor]] = field(default_factory=list)

    def add(self, truth: Truth, actor: Actor, motion: Motion, near: list[Tensor]) -> Tensor:
        """Score a motion; returns its surface."""
        surface, places = actor.surface(motion), actor.skeleton(motion).position
        for side in range(2):
            elevation = truth.elevation[:, side]
            apart = (surface - truth.surface)[:, near[side]].norm(dim=-1)
            self.surface.append((elevation, 1000 * apart))
            joint = JOINTS.index("lr"[side] + "_shoulder")
            apart = (places[:, joint] - truth.joints.position[:, joint]).norm(dim=-1)
            self.shoulder.append((elevation, 1000 * apart[:, None]))
        return surface


def run(config: Experiment) -> Report:
    """Score both kinds of shoulders on every clip."""
    with tempfile.TemporaryDirectory() as scratch:
        body = _body(config.data, Path(scratch))
    actors = {"still": body.with_still_shoulders(), "turning": body}
    ways = {"retargeted": _retargeted, "captured in four views": _captured}
    found = {way: {name: Apart() for name in actors} for way in ways}
    near = _near(body)
    for clip, rig in _clips(config):
        truth = pose_whole(body, rig, config.every)
        shown, highest = [truth.surface], int(truth.elevation.max(1).argmax())
        for way, solve in ways.items():
            for name, actor in actors.items():
                motion = solve(body, truth, actor, rig.rate / config.every)
                shown.append(found[way][name].add(truth, actor, motion, near))
        if config.pictures is not None:
            marks = carried_landmarks(body.skeleton, truth.joints)[highest]
            _draw(config.pictures / f"{clip}.png", body, [s[highest] for s in shown], marks)
    return Report(tuple(_table(way, list(both.values())) for way, both in found.items()))


def _table(way: str, both: list[Apart]) -> Table:
    rows = []
    for low, high in BANDS:
        before, after = (_mean(each.surface, low, high) for each in both)
        shoulder = [_mean(each.shoulder, low, high)[0] for each in both]
        change = 100 * (after[0] / before[0] - 1) if before[2] else math.nan
        rows.append((f"{low} to {high}", before[2], before[0], after[0], change,
                     before[1], after[1], *shoulder))  # fmt: skip
    columns = ("elevation °", "arms", "still mm", "turning", "%", "still 95 %", "turning",
               "still shoulder mm", "turning")  # fmt: skip
    title = f"{way}: surface within 16 cm of the shoulders, and the shoulders"
    return Table(title, columns, tuple(rows), 1)


def _retargeted(body: Actor, truth: Truth, actor: Actor, rate: float) -> Motion:
    return retarget(body, truth.joints, actor, rate).motion


def _captured(body: Actor, truth: Truth, actor: Actor, rate: float) -> Motion:
    """From exact detections of the landmarks."""
    landmarks, rng = carried_landmarks(body.skeleton, truth.joints), np.random.default_rng(0)
    cameras = around(landmarks, 4, rng)
    seen = observed(landmarks, cameras, rng, Noise(0, 0, 0, 0, 0))
    return capture(actor, cameras, seen, rate).motion


def pose_whole(body: Actor, rig: MovingRig, every: int) -> Truth:
    """The body with a recording's trunk, limbs and places of the shoulders."""
    template, like = body.template, body.vertices
    joints = JointMotion(torch.tensor(rig.rotation).to(like), torch.tensor(rig.position).to(like))
    turns = wanted_turns(rig.actor, joints, body.skeleton)[::every]
    scale = leg_length(body) / leg_length(rig.actor)
    shifts, elevation = zip(*(_shoulder(joints, side, scale) for side in "lr"), strict=True)
    names = {bone: joint for joint, bone in template.joint_bones.items()}
    clavicles = _clavicles(body)
    rest, count = torch.tensor(template.bone_rest[:, :3, 3]).to(like), len(turns)
    rotation: list[Tensor] = []
    position: list[Tensor] = []
    for bone, parent in enumerate(template.bone_parents.tolist()):
        above = rotation[parent] if parent >= 0 else torch.eye(3).to(like).expand(count, 3, 3)
        at = position[parent] + above @ (rest[bone] - rest[parent]) if parent >= 0 else rest[bone]
        position.append(at.expand(count, 3))
        if bone in names:
            above = turns[:, JOINTS.index(names[bone])]
        elif bone in clavicles:
            side = clavicles[bone]
            arm = rest[template.joint_bones[f"{side}_shoulder"]] - rest[bone]
            above = above @ _turn(arm, arm + shifts["lr".index(side)][::every])
        rotation.append(above)
    turned, placed = torch.stack(rotation, 1), torch.stack(position, 1)
    whole = SkinWeights(
        torch.tensor(template.weights).to(like), torch.tensor(template.weight_bones)
    )
    offset = placed - (turned @ rest[..., None])[..., 0]
    own = [template.joint_bones[name] for name in JOINTS]
    return Truth(
        JointMotion(turned[:, own], placed[:, own]),
        dual_quaternion_blend(like, whole, turned, offset),
        np.stack(elevation, -1)[::every],
    )


def _shoulder(joints: JointMotion, side: str, scale: float) -> tuple[Tensor, NDArray[np.float64]]:
    """How far a shoulder is from where it rests on the chest, (F, 3) m, and the arm's elevation."""
    chest = joints.rotation[:, SPINE].mT
    shoulder, elbow = (
        joints.position[:, JOINTS.index(f"{side}_{p}")] for p in ("shoulder", "elbow")
    )
    arm = unit_vectors((chest @ (elbow - shoulder)[..., None])[..., 0])
    elevation = arm[:, 1].neg().clamp(-1, 1).acos().rad2deg()
    place = (chest @ (shoulder - joints.position[:, SPINE])[..., None])[..., 0]
    neutral = (elevation - NEUTRAL).abs().argsort()[:NEUTRAL_FRAMES]
    return scale * (place - place[neutral].mean(0)), elevation.numpy()


def _turn(one: Tensor, others: Tensor) -> Tensor:
    """The least rotations (F, 3, 3) that point a vector (3,) at others (F, 3)."""
    first, last = unit_vectors(one).expand_as(others), unit_vectors(others)
    axis = torch.linalg.cross(first, last)
    return rotvec_to_matrix(
        unit_vectors(axis) * axis.norm(dim=-1, keepdim=True).clamp(max=1).asin()
    )


def _clavicles(body: Actor) -> dict[int, str]:
    """Sides by bone."""
    template = body.template
    found = clavicle_bones(
        template.bone_parents.tolist(), template.bone_rest[:, :3, 3], template.joint_bones
    )
    return {bone: name[0] for name, bone in found.items()}


def _near(body: Actor) -> list[Tensor]:
    """Vertices around the left and the right shoulder."""
    rest = body.skeleton.rest_positions
    return [(body.vertices - rest[JOINTS.index(f"{s}_shoulder")]).norm(dim=-1) < NEAR for s in "lr"]


def _mean(
    found: list[tuple[NDArray[np.float64], Tensor]], low: float, high: float
) -> tuple[float, float, int]:
    """Mean and 95th percentile of distances of arms within a band, and the number of arms."""
    parts = [apart[torch.tensor((e >= low) & (e < high))] for e, apart in found]
    every = torch.cat([part.flatten() for part in parts]).numpy()
    count = sum(len(part) for part in parts)
    if not count:
        return math.nan, math.nan, 0
    return float(every.mean()), float(np.quantile(every, 0.95)), count


def _clips(config: Experiment) -> Iterator[tuple[str, MovingRig]]:
    folder = data_folder(config.data, "mocap_bandai_bvh")
    for name in CLIPS:
        path = folder / f"dataset-1_{name}_normal_001.bvh"
        yield name, read_moving_rig(path, slice(0, config.frames))


def _body(data: Path, folder: Path) -> Actor:
    """MakeHuman's body as perfcap imports it."""
    skeleton, weights = rigs(data_folder(data, "makehuman"))["default"]
    assert weights is not None
    plain = build(data_folder(data, "makehuman"), skeleton, weights)
    still = np.tile(np.eye(4), (1, len(plain.bone_names), 1, 1))
    save_animation(folder / "body.glb", plain, still, 30.0)
    return import_actor(folder / "body.glb").actor


def _draw(path: Path, body: Actor, surfaces: list[Tensor], joints: Tensor) -> None:
    """One pose, (V, 3) each, beside one another, from ahead and from behind.

    Landmarks are those of the first, (16, 3).
    """
    every = torch.stack([joints, joints])
    panels = []
    for vertices in surfaces:
        shown = StoredSurface(torch.stack([vertices, vertices]))
        around = Surroundings.around(every, shown)
        views = orbit(every, around, [0, 1], SIZE, 30.0, 360.0)
        panels.append(np.concatenate(list(draw_free_view(body.template, shown, around, views)), 0))
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.concatenate(panels, 1)[..., ::-1])


if __name__ == "__main__":
    main(run, Experiment, "shoulders")
