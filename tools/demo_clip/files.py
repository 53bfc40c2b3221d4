"""Files of the demo: truth, camera, detections, and the manifest that seals them."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import torch
from detection_noise import detect
from numpy.typing import NDArray

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera

NAMES = ("video.mp4", "camera.json", "detections.npz", "truth.npz")
_ENTRY = """
[[file]]
name = "{name}"
size = {size}
sha256 = "{digest}"
licence = "{licence}"
origin = "{origin}"
"""
_LICENCE = "free for all uses, with the acknowledgement in card.md"
_ORIGIN = "tools/render_demo.py with the actor sam and motion of mocap.cs.cmu.edu"


def save_truth(path: Path, actor: Actor, motion: Motion, rate: float) -> None:
    """Write a motion as ``motion.npz`` holds it."""
    skeleton = actor.skeleton
    np.savez_compressed(
        path,
        joints3d=actor.joints(motion).numpy(),
        joint_names=np.array(skeleton.rig.landmarks),
        root_translation=motion.translation.numpy(),
        root_rotation=motion.rotation.numpy(),
        angles=motion.angles.numpy(),
        angle_names=np.array(skeleton.angle_names),
        angle_lower=skeleton.lower.numpy(),
        angle_upper=skeleton.upper.numpy(),
        frames=np.arange(motion.frames),
        fps=np.array(rate),
    )


def read_truth(path: Path, actor: Actor) -> tuple[Motion, float]:
    """A motion that was saved, and its rate; angles are taken within the actor's limits.

    Raises:
        InputError: it speaks of other angles than the actor has.
    """
    skeleton = actor.skeleton
    with np.load(path, allow_pickle=False) as data:
        if tuple(data["angle_names"]) != skeleton.angle_names:
            raise InputError(
                f"{path}: has angles {', '.join(data['angle_names'][:4])}, ...; expected "
                f"{', '.join(skeleton.angle_names[:4])}, ...; make a new motion with --cmu"
            )
        angles = torch.tensor(data["angles"]).clamp(skeleton.lower, skeleton.upper)
        place, turn = (torch.tensor(data[f"root_{part}"]) for part in ("translation", "rotation"))
        return Motion(place, turn, angles), float(data["fps"])


def save_camera(path: Path, camera: Camera, rate: float) -> None:
    """Write a fixed camera of one view, pixel centres at integers."""
    height, width = camera.size[0]
    entry = {
        "K": camera.intrinsics[0].tolist(),
        "R": camera.rotation[0].tolist(),
        "t": camera.translation[0].tolist(),
        "width": width,
        "height": height,
        "fps": rate,
        "pixel_centre": 0,
    }
    path.write_text(json.dumps(entry, indent=1) + "\n")


def save_detections(path: Path, camera: Camera, joints: torch.Tensor, seed: int) -> None:
    """Write what networks might have seen of landmarks (F, 16, 3) m in the world."""

    def project(local: NDArray[np.float64]) -> NDArray[np.float64]:
        pixels: NDArray[np.float64] = camera.project_camera(torch.tensor(local)[:, None]).numpy()
        return pixels[:, 0]

    seen = camera.to_camera(joints)[:, 0].numpy()
    joints2d, confidence, joints3d = detect(seen, np.random.default_rng(seed), project)
    np.savez_compressed(
        path,
        joints2d=joints2d.astype(np.float32),
        confidence2d=confidence.astype(np.float32),
        joints3d_mm=(1000 * joints3d).astype(np.float32),
        joint_names=np.array(LANDMARKS),
    )


def save_manifest(folder: Path) -> None:
    """Write size and hash of every file of the demo."""
    text = "# What this folder ships and where it comes from.\n"
    for name in NAMES:
        data = (folder / name).read_bytes()
        digest = hashlib.sha256(data).hexdigest()
        text += _ENTRY.format(
            name=name, size=len(data), digest=digest, licence=_LICENCE, origin=_ORIGIN
        )
    (folder / "manifest.toml").write_text(text.replace("\n\n[[file]]", "\n[[file]]", 1))
