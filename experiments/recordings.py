"""The recordings that experiments score on: what goes in, and the truth that never does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from report import data_folder
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.geometry.triangulation import translation_from_plane
from perfcap.io.actor import load_actor, models_folder
from perfcap.io.calibration import CameraRig, read_cameras
from perfcap.io.datasets import DatasetSequence, find_dataset
from perfcap.io.detections import read_detections


@dataclass(frozen=True)
class Recording:
    """One person in C views: inputs, and the truth for scoring only.

    Attributes:
        name: of the recording.
        folder: where it is.
        actor: the person's template, or a generic one.
        rig: C calibrated views.
        detections: (F, C, 16).
        rate: frames a second.
        truth: landmarks in the world, (F, 16, 3) m, NaN where unknown.
        sequence: the rest of the truth, as its data set has it.
    """

    name: str
    folder: Path
    actor: Actor
    rig: CameraRig
    detections: Detections
    rate: float
    truth: Tensor
    sequence: DatasetSequence | None = None

    @property
    def cameras(self) -> Camera:
        """The views."""
        return self.rig.cameras

    def part(self, views: Sequence[int], frames: int) -> Recording:
        """Some views of the first frames, as many as there are at most."""
        count = slice(0, min(frames, self.detections.frame_count))
        seen = self.detections.select(list(views)).frames(count)
        rig = self.rig.select(list(views))
        return replace(self, rig=rig, detections=seen, truth=self.truth[count])


def rendered(data: Path, name: str) -> Recording:
    """A rendered sequence in one view, with simulated 2D and 3D detections."""
    sequence = find_dataset("rendered").read(data_folder(data, "rendered"), name)
    return _read(name, sequence.folder, sequence)


def rendered_views(data: Path, name: str, person: int = 1) -> Recording:
    """A person of a rendered sequence in several views, with simulated 2D detections."""
    folder = data_folder(data, "rendered_multi")
    sequence = find_dataset("rendered").read(folder, f"{name}/{person}")
    return _read(name, folder / name, sequence)


def balancing(data: Path, actor: str = "sam") -> Recording:
    """A real man balancing, in four views; the truth is triangulated, good to some centimetres."""
    sequence = find_dataset("pose2sim").read(data_folder(data), "pose2sim_balancing")
    rig, truth = _known(sequence)
    paths = sorted((sequence.folder / "pose2d_associated").glob("*_json"))
    detections, _ = read_detections(paths, views=rig.names)
    frames = min(len(truth), detections.frame_count)
    detections, truth = detections.frames(slice(0, frames)), truth[:frames]
    person = load_actor(actor)
    return Recording(
        "balancing", sequence.folder, person, rig, detections, sequence.rate, truth, sequence
    )


def lift(recording: Recording) -> Tensor:
    """The 3D detections as they are, moved to where they project onto the 2D ones, (F, 16, 3)."""
    camera, detections = recording.cameras, recording.detections
    assert detections.joints3d is not None
    plane = camera.to_plane(detections.joints2d)
    shift, _ = translation_from_plane(detections.joints3d, plane, detections.confidence2d)
    local = detections.joints3d + shift.unsqueeze(-2)
    return ((local - camera.translation.unsqueeze(-2)) @ camera.rotation)[:, 0]


def exact_detections(recording: Recording) -> Detections:
    """True projections and true 3D joints; for scoring only."""
    camera, truth = recording.cameras, recording.truth
    local = camera.to_camera(truth)
    pixels = camera.project_camera(local)
    return Detections.from_joints(
        pixels, torch.ones_like(pixels[..., 0]), local - mid_hip(local).unsqueeze(-2)
    )


def _read(name: str, folder: Path, sequence: DatasetSequence) -> Recording:
    rig, truth = _known(sequence)
    detections, _ = read_detections(
        sequence.folder / "detections.npz", views=rig.names, pixel_offset=rig.pixel_offset
    )
    actor = load_actor(sequence.folder / "template.glb")
    return Recording(name, folder, actor, rig, detections, sequence.rate, truth, sequence)


def _known(sequence: DatasetSequence) -> tuple[CameraRig, Tensor]:
    assert sequence.rig is not None and sequence.joints3d is not None
    return sequence.rig, sequence.joints3d


def demo() -> Recording:
    """The clip that perfcap ships, which was rendered from its own actor."""
    folder = models_folder() / "demo"
    rig = read_cameras(folder / "camera.json")
    detections, _ = read_detections(folder / "detections.npz", views=rig.names)
    with np.load(folder / "truth.npz", allow_pickle=False) as file:
        truth, rate = torch.tensor(file["joints3d"]), float(file["fps"])
    return Recording("demo", folder, load_actor("sam"), rig, detections, rate, truth)


def demo_motion() -> Motion:
    """The motion that the demo clip was rendered from; for scoring only."""
    with np.load(models_folder() / "demo" / "truth.npz", allow_pickle=False) as file:
        keys = ("root_translation", "root_rotation", "angles")
        translation, rotation, angles = (torch.tensor(file[key]) for key in keys)
        return Motion(translation, rotation, angles)


def stored_image(path: Path) -> NDArray[np.uint8]:
    """An image as its file stores it: gray values that are numbers of people, say."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise FileNotFoundError(path)
    stored: NDArray[np.uint8] = image.astype(np.uint8)
    return stored
