"""Twenty results that differ in actor, rig, length, rate, surface, axes, texture and names."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from makehuman_rigs import build, rigs
from numpy.typing import NDArray
from report import data_folder
from scipy.spatial.transform import Rotation
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import linear_blend
from perfcap.io.actor import find_actor, load_actor
from perfcap.io.actor_import import import_actor
from perfcap.io.export import Recording
from perfcap.io.gltf_write import save_animation
from perfcap.pipeline import CaptureConfig
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from foreign_rigs import RIGS
from synthetic import actor as person
from takes import make_take, marked_template, sway

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """How a result is made.

    Attributes:
        name: of its folder.
        actor: a name, a file, or a module.
        frames: F.
        rate: frames a second.
        surface: whether it has one.
        turn: rotation of the capture's world, Euler angles about x and z, degrees.
        own: the user's own file, onto which animations should play.
    """

    name: str
    actor: str | Path | Actor
    frames: int = 24
    rate: float = 30.0
    surface: bool = True
    turn: tuple[float, float] = (0.0, 0.0)
    own: Path | None = None


def cases(data: Path, folder: Path) -> Iterator[Case]:
    """All of them; files of actors are made in ``folder``."""
    yield Case("sam, motion only", "sam", surface=False)
    yield Case("sam, own file", "sam", own=find_actor("sam").path)
    yield Case("sam, 300 frames", "sam", frames=300)
    yield Case("sam, 900 frames, motion only", "sam", frames=900, surface=False)
    yield Case("sam, one frame", "sam", frames=1)
    yield Case("sam, 59.94 a second", "sam", rate=60000 / 1001)
    yield Case("sam, z up", "sam", turn=(90.0, 0.0))
    yield Case("sam, y down", "sam", turn=(180.0, 0.0))
    yield Case("sam, x up", "sam", turn=(0.0, -90.0), surface=False)
    yield Case("Zoë & Łukasz: sam's “take” 1", "sam", frames=20)
    for name in ("dev_tight", "dev_skirt"):
        yield Case(name, data_folder(data, "rendered", name) / "template.glb", rate=120.0)
    for number, (name, rig) in enumerate(RIGS.items()):
        own = folder / f"foreign_{number}.glb"
        rig.write(own)
        mixamo = own if name.startswith("Mixamo") else None
        yield Case(name, own, surface=number % 2 == 0, own=mixamo)
    makehuman = data_folder(data, "makehuman")
    skeleton, weights = rigs(makehuman)["default"]
    assert weights is not None
    template, own = build(makehuman, skeleton, weights), folder / "makehuman.glb"
    save_animation(own, template, np.tile(np.eye(4), (1, len(template.bone_names), 1, 1)), 30.0)
    yield Case("MakeHuman default", own, own=own)
    template = replace(marked_template(), texture=None, name="no/texture \\ or ü")
    yield Case("tubes without a texture", Actor(template), rate=24.0)


def save(case: Case, folder: Path) -> Path:
    """Write the result of a case as a capture does."""
    actor = case.actor
    if isinstance(actor, str):
        actor = load_actor(actor)
    elif isinstance(actor, Path):
        actor = import_actor(actor).actor
    actor = actor.double()
    motion = _turned(sway(actor, case.frames, case.rate, turns=0.7), case.turn)
    take = make_take(2, actor=person())  # cameras and detections do not leave
    surface = None
    if case.surface:
        surface = StoredSurface(_breathing(SkinnedSurface(actor, motion)[:]).float())
    parts = (actor, take.cameras, take.detections, motion, case.rate, CaptureConfig())
    path = folder / case.name.replace("/", "_")
    Performance(*parts, surface=surface).save(path, first_frame=7)
    return path


def _turned(motion: Motion, turn: tuple[float, float]) -> Motion:
    """The motion in a world that lies on its side."""
    matrix = Rotation.from_euler("xz", turn, degrees=True)
    rotation = matrix * Rotation.from_rotvec(motion.rotation.numpy())
    place = motion.translation @ torch.tensor(matrix.as_matrix()).T
    return replace(motion, translation=place, rotation=torch.tensor(rotation.as_rotvec()))


def _breathing(vertices: Tensor) -> Tensor:
    """A surface (F, V, 3) that swells by up to 6 % and back, and is dented here and there."""
    time = torch.arange(len(vertices))[:, None, None]
    middle = vertices.mean(1, keepdim=True)
    swollen = middle + (1 + 0.06 * (0.4 * time).sin() ** 2) * (vertices - middle)
    dents = np.random.default_rng(0).normal(0, 0.004, vertices.shape[1:])
    return swollen + torch.tensor(dents) * (0.3 * time).cos()


def linear_skin(recording: Recording, frames: list[int]) -> Floats:
    """The skin as programs blend it: linearly."""
    template = recording.template
    skin = SkinWeights(torch.tensor(template.weights), torch.tensor(template.weight_bones))
    moved = torch.tensor(recording.bone_transforms[frames])
    vertices = torch.tensor(template.vertices)
    return linear_blend(vertices, skin, moved[..., :3, :3], moved[..., :3, 3]).numpy()


def apart(one: Floats, two: Floats) -> float:
    """Largest distance of points, mm."""
    assert one.shape == two.shape, (one.shape, two.shape)
    return 1000 * float(np.linalg.norm(one - two, axis=-1).max())


def turned(one: Floats, two: Floats) -> float:
    """Largest angle between rotations, degrees."""
    between = (one.swapaxes(-1, -2) @ two).reshape(-1, 3, 3)
    return float(np.degrees(Rotation.from_matrix(between).magnitude().max()))
