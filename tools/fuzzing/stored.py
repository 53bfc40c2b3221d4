"""What perfcap itself writes and reads again, and pictures and videos, and their readers."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from fuzzing.mutate import Random
from fuzzing.targets import Target
from takes import write_video

from perfcap.actor.volume import Volume
from perfcap.io.actor import models_folder
from perfcap.io.clip import Clip
from perfcap.io.fitted_body import FittedBody, load_fitted_body, save_fitted_body
from perfcap.io.pose_prior import load_pose_prior
from perfcap.io.surface_file import open_surface
from perfcap.io.volume_file import load_volume, save_volume
from perfcap.train.checkpoint import Checkpoint, load_checkpoint, save_checkpoint

_SIZE = (32, 40)


def stored(root: Path, result: Path) -> list[Target]:
    """Bodies, priors, surfaces, volumes and checkpoints; folders of images, and videos.

    Args:
        root: where folders are made.
        result: of a capture with a surface.
    """
    places = {name: root / name for name in _READERS}
    for folder in places.values():
        folder.mkdir(parents=True)
    body = FittedBody(np.zeros(3), np.eye(3), "ada")
    save_fitted_body(places["fitted_body"] / "body.npz", body)
    shutil.copy(models_folder() / "priors" / "cmu" / "prior.npz", places["prior"])
    shutil.copy(result / "surface.npz", places["surface"])
    save_volume(places["volume"] / "volume.npz", _volume(), ("pelvis", "head"))
    values = {"step": "1", "best": "2.0", "config": "{}"}
    checkpoint = Checkpoint({"average.a": torch.zeros(3)}, values, Path("a"))
    save_checkpoint(places["checkpoint"] / "a.safetensors", checkpoint)
    for number, ending in enumerate((".png", ".jpg", ".bmp", ".tif", ".webp")):
        picture = np.full((*_SIZE, 3), 50 * number, np.uint8)
        picture[5:20] = 200
        cv2.imwrite(str(places["images"] / f"{number}{ending}"), picture)
    write_video(places["video"] / "a.mp4", 5, _SIZE)
    return [Target(name, places[name], read) for name, read in _READERS.items()]


def _volume() -> Volume:
    two = torch.full((2,), 0.1, dtype=torch.float64)
    centres = torch.zeros(2, 3, dtype=torch.float64)
    return Volume(centres, two, two, torch.tensor([0, 1]), torch.full((2, 3), 0.5).double())


def _images(folder: Path, _: Random) -> Any:
    return Clip.open(str(folder)).read(0, 5)


def _video(folder: Path, _: Random) -> Any:
    clip = Clip.open(str(folder / "a.mp4"))
    return clip.read(0, len(clip)), clip.fps


def _surface(folder: Path, _: Random) -> Any:
    found = open_surface(folder / "surface.npz")
    return found.read(slice(0, 2)), found.faces, found.frames


def _gaussians(folder: Path, _: Random) -> Any:
    found = load_volume(folder / "volume.npz")[0]  # NaN are colours that nothing showed
    return replace(found, colors=None), found.colors is None or found.colors.nan_to_num(0.5)


_READERS = {
    "fitted_body": lambda f, _: load_fitted_body(f / "body.npz"),
    "prior": lambda f, _: load_pose_prior(f / "prior.npz"),
    "surface": _surface,
    "volume": _gaussians,
    "checkpoint": lambda f, _: load_checkpoint(f / "a.safetensors").values,
    "images": _images,
    "video": _video,
}
