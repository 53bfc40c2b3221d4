"""Stills and masks from a video that goes around a person (`perfcap actor frames`).

A clothed character stands in a place made of photographs; a camera goes around at an uneven pace,
and some frames are smeared as a shaken hand smears them. The right answer is known: angles, smears,
masks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import report
import skimage.data
import torch
from numpy.typing import NDArray
from report import Report, Table, data_folder

from perfcap.actor.actor import Actor
from perfcap.app.actor_frames import neighbours
from perfcap.io.actor import load_actor
from perfcap.metrics import mask_overlap
from perfcap.pipeline.appearance import Appearance
from perfcap.pipeline.camera_path import orbit
from perfcap.pipeline.surroundings import Surroundings
from perfcap.render import DAYLIGHT, ProjectedMesh, render
from perfcap.segment.central_person import central_person
from perfcap.segment.still_frames import Stills, choose_stills, look_over

_CLOSER = 1.35  # the orbiting camera leaves room that a picture for photogrammetry does not need

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Experiment:
    """What to film."""

    data: Path = report.DATA
    """Folder of the recordings."""
    actors: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Characters of ``rendered``."""
    frames: int = 240
    """Of the video."""
    count: int = 60
    """Stills to choose."""
    size: tuple[int, int] = (640, 360)
    """Height and width, px."""
    smeared: float = 0.4
    """Share of frames that are smeared."""
    seed: int = 3
    """Of smears and pace."""


@dataclass(frozen=True, eq=False)
class Orbit:
    """A video with its truth: pictures, masks, angles (F,) in degrees, smears (F,) in pixels."""

    pictures: list[Image]
    masks: list[Mask]
    angles: NDArray[np.float64]
    smears: NDArray[np.float64]


def run(config: Experiment) -> Report:
    """Choose and cut out."""
    chosen_rows, mask_rows = [], []
    for name in config.actors:
        actor = load_actor(data_folder(config.data, "rendered", name) / "template.glb")
        film = film_orbit(actor, config)
        stills = look_over(film.pictures)
        chosen = choose_stills(stills, config.count)
        even = np.linspace(0, config.frames - 1, config.count).round().astype(int).tolist()
        chosen_rows += [
            (name, "chosen", *_spread(film, chosen)),
            (name, "evenly in time", *_spread(film, even)),
        ]
        mask_rows.append((name, *_overlaps(film, stills, chosen)))
    columns = ("character", "frames", "number", "largest gap, degrees", "smear, px", "smeared, %")
    masks = ("character", "IoU", "recall", "IoU without motion", "IoU, worst tenth")
    return Report(
        (
            Table("stills", columns, tuple(chosen_rows)),
            Table("masks, %", masks, tuple(mask_rows)),
        )
    )


def _spread(film: Orbit, frames: list[int]) -> tuple[float, ...]:
    gaps = np.diff([*film.angles[frames], film.angles[frames[0]] + 360])
    smear = film.smears[frames]
    return len(frames), float(gaps.max()), float(smear.mean()), 100 * float((smear > 2).mean())


def _overlaps(film: Orbit, stills: Stills, frames: list[int]) -> tuple[float, ...]:
    """Overlap and recall of masks with motion, overlap without, %."""
    found: dict[str, list[float]] = {"iou": [], "recall": [], "alone": []}
    for frame in frames:
        around = [film.pictures[f] for f in neighbours(stills, frame)]
        moved = mask_overlap(central_person(film.pictures[frame], around), film.masks[frame])
        alone = mask_overlap(central_person(film.pictures[frame]), film.masks[frame])
        for name, value in (("iou", moved.iou), ("recall", moved.recall), ("alone", alone.iou)):
            found[name].append(100 * value)
    iou = found["iou"]
    means = (float(np.mean(found[name])) for name in ("iou", "recall", "alone"))
    return (*means, float(np.quantile(iou, 0.1)))


def film_orbit(actor: Actor, config: Experiment) -> Orbit:
    """Go around at an uneven pace."""
    rng = np.random.default_rng(config.seed)
    pace = 1 + 0.8 * np.sin(np.linspace(0, 6 * math.pi, config.frames) + rng.uniform(0, 6))
    angles = 360 * np.concatenate([[0], np.cumsum(pace)[:-1]]) / pace.sum()
    shaken = rng.uniform(size=config.frames) < config.smeared
    smears = np.where(shaken, rng.uniform(3, 9, config.frames), 0)
    smears[0] = 0
    pictures, masks = [], []
    for (picture, mask), length in zip(_seen(actor, angles, config), smears, strict=True):
        pictures.append(_smear(picture, length, rng))
        masks.append(mask)
    return Orbit(pictures, masks, angles, smears)


def _seen(
    actor: Actor, angles: NDArray[np.float64], config: Experiment
) -> Iterator[tuple[Image, Mask]]:
    rest = actor.skeleton.rest_motion()
    up, ahead = torch.eye(3, dtype=torch.float64)[[1, 2]]
    joints = actor.joints(rest).double()
    vertices = actor.surface(rest)[0].detach().double()
    look = Appearance.of(actor.template)
    ground = float(vertices[:, 1].min())
    around = 3600
    large = (round(_CLOSER * config.size[0]), round(_CLOSER * config.size[1]))
    path = orbit(joints, Surroundings(up, ahead, ground), [0] * around, large, 30.0)
    cut = tuple(
        slice((a - b) // 2, (a - b) // 2 + b) for a, b in zip(large, config.size, strict=True)
    )
    wall, floor = _panorama(large[0] // 2), skimage.data.gravel()
    for angle in angles:
        camera = path.camera(round(angle / 360 * around) % around)
        behind = torch.from_numpy(_place(wall, floor, float(angle), large))
        mesh = ProjectedMesh.seen_by(camera, vertices[look.representative].float(), look.faces)
        drawn = render(mesh, look.texture, behind, DAYLIGHT)
        picture: Image = drawn.image.numpy()
        yield picture[cut], mesh.rasterize().mask.numpy()[cut]


def _panorama(height: int) -> Image:
    """Photographs side by side, as far away walls."""
    names = ("brick", "coffee", "chelsea", "astronaut", "rocket", "motorcycle_left", "grass")
    parts = []
    for name in names:
        loaded = (
            skimage.data.stereo_motorcycle()[0]
            if "motor" in name
            else getattr(skimage.data, name)()
        )
        image = cv2.cvtColor(loaded, cv2.COLOR_GRAY2RGB) if loaded.ndim == 2 else loaded[..., :3]
        parts.append(cv2.resize(image, (round(image.shape[1] * height / image.shape[0]), height)))
    row = np.concatenate(parts, 1)
    joined: Image = np.concatenate((row, np.roll(row, row.shape[1] // 3, 1)))
    return joined


def _place(wall: Image, floor: Image, angle: float, size: tuple[int, int]) -> Image:
    """What lies behind the person at an angle: walls, and a floor below."""
    height, width = size
    start = int(angle / 360 * wall.shape[1])
    columns = (start + np.arange(width)) % wall.shape[1]
    picture = np.ascontiguousarray(wall[:, columns][:height])
    edge = int(0.72 * height)
    near = cv2.resize(floor, (2 * width, 2 * height))
    shift = int(angle * width / 45) % width
    picture[edge:] = near[edge:height, shift : shift + width, None]
    return picture


def _smear(picture: Image, length: float, rng: np.random.Generator) -> Image:
    noisy = picture + rng.normal(0, 2, picture.shape)
    if length > 0:
        count = max(2, round(length))
        kernel = np.zeros((count, count), np.float32)
        turn = rng.uniform(0, math.pi)
        for t in np.linspace(-0.5, 0.5, 4 * count):
            x, y = (int((count - 1) * (0.5 + t * f(turn))) for f in (math.cos, math.sin))
            kernel[y, x] = 1
        noisy = cv2.filter2D(picture, -1, kernel / kernel.sum()) + rng.normal(0, 2, picture.shape)
    smeared: Image = np.clip(noisy, 0, 255).astype(np.uint8)
    return smeared


if __name__ == "__main__":
    report.main(run, Experiment, "orbit_frames")
