"""Synthetic takes: a person in smooth motion, exact detections, and all of it as files."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from synthetic import actor as person
from synthetic import cameras as circle
from synthetic import template
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.template import Template
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.gltf_write import save_animation
from perfcap.io.video_writer import VideoWriter
from perfcap.pipeline.objective import neutral_angles
from perfcap.render.projected_mesh import ProjectedMesh

F64 = torch.float64


@dataclass(frozen=True)
class Take:
    """What a capture is given, and the motion it should find."""

    actor: Actor
    cameras: Camera
    detections: Detections
    truth: Motion
    rate: float

    def error_mm(self, joints: Tensor) -> Tensor:
        """Mean joint error of each frame, (F,), millimetres."""
        return 1000 * (joints - self.actor.joints(self.truth)).norm(dim=-1).mean(-1)


def make_take(
    frames: int = 60,
    *,
    views: int = 1,
    lifted: bool = True,
    rate: float = 30.0,
    turns: float = 0.0,
    moving: bool = False,
    actor: Actor | None = None,
) -> Take:
    """Exact detections of a person who sways, walks about and turns.

    Args:
        frames: F.
        views: C, a third of a circle of 5 m apart.
        lifted: whether detections have 3D joints.
        rate: frames a second; the motion is the same in time.
        turns: full turns of the person a second.
        moving: whether the cameras move.
        actor: the person; the one of ``synthetic`` when not given.
    """
    actor = actor or person()
    truth = sway(actor, frames, rate, turns)
    # of two views that face each other, neither shows the depth of the other
    cameras = circle(max(views, 3), size=600).select(list(range(views)))
    if moving:
        cameras = handheld(cameras, frames)
    return Take(actor, cameras, detect(actor, cameras, truth, lifted), truth, rate)


def sway(
    actor: Actor, frames: int, rate: float = 30.0, turns: float = 0.0, most: float = 0.5
) -> Motion:
    """A smooth motion below 1 Hz around a relaxed pose, well within the limits, (F,)."""
    time = torch.arange(frames, dtype=F64)[:, None] / rate
    skeleton = actor.skeleton
    middle = neutral_angles(actor)
    room = torch.minimum(middle - skeleton.lower, skeleton.upper - middle).clamp(max=most)
    count = len(middle)
    phase = torch.arange(count, dtype=F64) * 2.4
    pace = 0.4 + 0.5 * torch.arange(count, dtype=F64) / count  # Hz
    angles = middle + 0.7 * room * torch.sin(2 * math.pi * pace * time + phase)
    slow = 2 * math.pi * 0.3 * time
    place = torch.cat((0.3 * slow.sin(), 0.03 * (2 * slow).sin(), 0.3 * slow.cos()), -1)
    heading = 2 * math.pi * turns * time + 0.4 * torch.sin(slow)
    heading = torch.remainder(heading + math.pi, 2 * math.pi) - math.pi  # as vectors are stored
    rotation = heading * torch.tensor([0.0, 1.0, 0.0], dtype=F64)
    return Motion(place, rotation, angles)


def handheld(cameras: Camera, frames: int) -> Camera:
    """Fixed cameras (C,) set in motion: (F, C)."""
    time = torch.arange(frames, dtype=F64)[:, None, None] / 30
    shake = torch.cat((0.05 * time.sin(), 0.1 * (0.7 * time).sin(), 0.05 * time.cos()), -1)
    shift = torch.cat((0.2 * time.sin(), 0.1 * time.cos(), 0.3 * (0.5 * time).sin()), -1)
    return replace(
        cameras,
        intrinsics=cameras.intrinsics.expand(frames, *cameras.intrinsics.shape),
        rotation=rotvec_to_matrix(shake) @ cameras.rotation,
        translation=cameras.translation + shift,
    )


def standing_take(frames: int) -> Take:
    """A person who stands still, filmed by a camera in a hand."""
    take = make_take(frames, moving=True)
    still = take.truth.map(lambda part: part[:1].expand(frames, *part.shape[1:]))
    cameras = handheld(make_take(1).cameras, frames)
    found = detect(take.actor, cameras, still)
    return replace(take, truth=still, cameras=cameras, detections=found)


def detect(actor: Actor, cameras: Camera, motion: Motion, lifted: bool = True) -> Detections:
    """Exact detections, (F, C), of confidence 1."""
    joints = actor.joints(motion)
    pixels = cameras.project(joints)
    local = cameras.to_camera(joints)
    joints3d = local - mid_hip(local).unsqueeze(-2) if lifted else None
    return Detections.from_joints(pixels, torch.ones_like(pixels[..., 0]), joints3d)


def without(detections: Detections, frames: slice, views: slice = slice(None)) -> Detections:
    """Nobody detected in some frames of some views."""
    confidence, trusted = detections.confidence2d.clone(), detections.trusted3d.clone()
    confidence[frames, views] = 0
    trusted[frames, views] = False
    return replace(detections, confidence2d=confidence, trusted3d=trusted)


# --- files ----------------------------------------------------------------------------------------


def marked_template() -> Template:
    """The person's template with its landmarks as bones without weights, as files need them."""
    plain = template()
    rest = np.tile(np.eye(4), (len(plain.landmarks), 1, 1))
    rest[:, :3, 3] = [place for _, place in plain.landmarks.values()]
    return replace(
        plain,
        bone_names=(*plain.bone_names, *plain.landmarks),
        bone_parents=np.append(plain.bone_parents, [bone for bone, _ in plain.landmarks.values()]),
        bone_rest=np.concatenate((plain.bone_rest, rest)),
        landmarks={},
    )


@dataclass(frozen=True)
class TakeFiles:
    """A take on disk, and the command line that captures it."""

    folder: Path
    take: Take

    @property
    def actor(self) -> Path:
        return self.folder / "actor.glb"

    @property
    def video(self) -> Path:
        return self.folder / "video.mp4"

    @property
    def camera(self) -> Path:
        return self.folder / "camera.json"

    @property
    def detections(self) -> Path:
        return self.folder / "detections.npz"

    @property
    def truth(self) -> Path:
        return self.folder / "truth.npz"

    def command(self, out: Path, *more: str, **changes: object) -> list[str]:
        """Arguments of ``perfcap``; ``changes`` replace videos, actor, cameras or detections.

        Ends at the motion unless told otherwise: the images of these takes show dots.
        """
        parts = {
            "actor": self.actor,
            "cameras": self.camera,
            "detections": self.detections,
            "out": out,
        } | {key: value for key, value in changes.items() if key != "video"}
        options = [str(text) for key, value in parts.items() for text in (f"--{key}", value)]
        options += [] if "--until" in more else ["--until", "track_motion"]
        return ["capture", str(changes.get("video", self.video)), *options, *more]


def silhouettes(take: Take) -> list[np.ndarray]:
    """True masks of each frame of a take of one view, (H, W) bool."""
    faces = torch.as_tensor(take.actor.template.faces.copy())
    return [
        ProjectedMesh.seen_by(take.cameras, vertices, faces).rasterize().mask.numpy()
        for vertices in take.actor.surface(take.truth)
    ]


def write_take(
    folder: Path,
    frames: int = 24,
    *,
    size: tuple[int, int] = (120, 160),
    lifted: bool = True,
    moving: bool = False,
) -> TakeFiles:
    """A take of one small view as the files of a capture."""
    actor = Actor(marked_template())
    take = make_take(frames, lifted=lifted, actor=actor, moving=moving)
    take = replace(take, cameras=shrunk(take.cameras, size))
    take = replace(take, detections=detect(actor, take.cameras, take.truth, lifted))
    files = TakeFiles(folder, take)
    write_actor(files.actor, actor.template)
    write_video(files.video, frames, size, take.rate, seen=take.detections.joints2d[:, 0])
    write_json(files.camera, camera_entry(take.cameras))
    write_detections(files.detections, take.detections)
    write_truth(files.truth, take)
    return files


def shrunk(cameras: Camera, size: tuple[int, int]) -> Camera:
    """Cameras of another image size that see the same, about the middle of the image."""
    focal = 1.0 * size[0]
    matrix = [[focal, 0.0, size[1] / 2], [0.0, focal, size[0] / 2], [0.0, 0.0, 1.0]]
    intrinsics = torch.tensor(matrix, dtype=F64).expand(cameras.intrinsics.shape)
    return replace(cameras, intrinsics=intrinsics, size=(size,) * len(cameras.size))


def write_actor(path: Path, template: Template) -> None:
    rest = np.tile(np.eye(4), (1, len(template.bone_names), 1, 1))
    save_animation(path, template, rest, 30)


def write_video(
    path: Path,
    frames: int,
    size: tuple[int, int],
    rate: float = 30.0,
    half: int = 20,
    seen: torch.Tensor | None = None,
) -> None:
    """A room with a dark half; each frame is a little brighter than the last.

    Nobody is in it, or a dot at each joint (F, 16, 2) that is ``seen``.
    """
    room = np.full((*size, 3), 60, np.uint8)
    room[:, size[1] // 2 :] = half
    with VideoWriter(path, rate, preset="ultrafast") as writer:
        for i in range(frames):
            image = room + np.uint8(i % 128)
            for x, y in () if seen is None else seen[i].round().int().tolist():
                cv2.circle(image, (x, y), 3, (120, 40, 200), -1)
            writer.write(image)


def camera_entry(cameras: Camera, view: int = 0) -> dict[str, Any]:
    """One view as ``camera.json`` states it."""
    one = cameras.select([view])
    height, width = one.size[0]
    return {
        "K": one.intrinsics.squeeze(-3).tolist(),
        "R": one.rotation.squeeze(-3).tolist(),
        "t": one.translation.squeeze(-2).tolist(),
        "width": width,
        "height": height,
    }


def write_json(path: Path, value: object) -> None:
    path.write_text(json.dumps(value))


def write_detections(path: Path, detections: Detections, **more: Any) -> None:
    """One view's detections; ``more`` adds or replaces arrays."""
    arrays: dict[str, Any] = {
        "joints2d": detections.joints2d[:, 0].numpy(),
        "confidence2d": detections.confidence2d[:, 0].numpy(),
        "joint_names": np.array(LANDMARKS),
    }
    if detections.joints3d is not None:
        arrays["joints3d_mm"] = 1000 * detections.joints3d[:, 0].numpy()
    np.savez(path, **arrays | more)


def write_truth(path: Path, take: Take) -> None:
    joints = take.actor.joints(take.truth).numpy()
    np.savez(path, joints3d=joints, frames=np.arange(len(joints)), fps=np.array(take.rate))
