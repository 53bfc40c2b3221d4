"""Tracks that networks find of rendered people, with the truth: a lifter can learn their errors.

People of random shape in random clothes, skirts and coats among them, move as recorded, with arms
of other clips and limbs held otherwise, before random cameras. The default networks follow them in
the videos, as a capture would.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import report
import torch
from filmed_people import LENSES, exaggerated, standing_camera
from numpy.typing import NDArray
from report import Report, Table, data_folder
from torch import Tensor

from perfcap.app.networks import DETECTORS, Detecting, detect_clip, find_model
from perfcap.commands.views import DEFAULT_DETECTORS
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.retarget import mid_hip
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.actor import load_actor
from perfcap.io.body_model import load_body_model
from perfcap.io.clip import Clip
from perfcap.io.video_writer import VideoWriter
from perfcap.render import ProjectedMesh, Texture, render
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.cast import Cast
from perfcap.train.config import SceneData
from perfcap.train.motion_library import RATE, MotionLibrary, Recording
from perfcap.train.scenes import random_lighting

_STEPS = (2, 2, 3)  # recorded frames between those of a video of 30 Hz: as it was, or faster
_FOLLOWED = 10.0  # percent of a person's height: networks that err by more follow something else
_TILTS = (-15, 40)  # degrees by which cameras look down
_SKIRTS, _SAMS, _LOOSE = 0.35, 0.15, 6.0  # shares of people; degrees that limbs are turned by


@dataclass(frozen=True)
class Experiment:
    """What to make."""

    data: Path = report.DATA
    """Folder of the recordings, with mocap_cmu_library in it."""
    out: Path = report.RESULTS / "filmed_tracks.npz"
    """File of tracks to write."""
    people: tuple[str, ...] = ("01", "02", "03", "05")
    """Whose motion."""
    count: int = 24
    """Videos."""
    frames: int = 96
    """Of each."""
    size: int = 448
    """Pixels along their square images."""
    seed: int = 0
    """Of everything random."""
    hard: float = 0.3
    """Share of people whose limbs turn farther than recorded."""
    processes: int = 1
    """That work at once."""


@dataclass(frozen=True)
class Tracked:
    """A person in a video as networks see them, and the truth.

    Attributes:
        joints2d: (F, 16, 2), pixels.
        confidence: (F, 16).
        truth: in camera axes, (F, 16, 3), metres.
        intrinsics: of the camera, (3, 3).
    """

    joints2d: NDArray[np.float32]
    confidence: NDArray[np.float32]
    truth: NDArray[np.float32]
    intrinsics: NDArray[np.float32]


def run(config: Experiment) -> Report:
    """Make videos, follow the people in them, keep the tracks; how far they are off."""
    made = write_tracks(config)
    title = f"joints beside the truth, percent of the height, {len(made)} of {config.count} videos"
    return Report((Table(title, ("landmark", "median", "90 %"), _rows(made)),))


def write_tracks(config: Experiment, *, all_of_them: bool = False) -> list[Tracked]:
    """Make tracks and keep them in a file: of people who were followed, or all of them."""
    made = list(tracks(config))
    if not all_of_them:
        made = [track for track in made if np.nanmedian(_off(track)) < _FOLLOWED]
    stacked: dict[str, Any] = {
        name: np.stack([getattr(track, name) for track in made])
        for name in Tracked.__dataclass_fields__
    }
    config.out.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(config.out, **stacked)
    return made


def tracks(config: Experiment) -> Iterator[Tracked]:
    """As many as asked for; those of a seed are always the same."""
    make = partial(_tracked, config)
    if config.processes == 1:
        yield from filter(None, map(make, range(config.count)))
        return
    with ProcessPoolExecutor(config.processes, get_context("spawn")) as pool:
        yield from filter(None, pool.map(make, range(config.count)))


_STAGE: dict[Experiment, tuple[Cast, tuple[Recording, ...], tuple[OnnxDetector, ...]]] = {}


def _stage(config: Experiment) -> tuple[Cast, tuple[Recording, ...], tuple[OnnxDetector, ...]]:
    """Whom to film and who looks, once a process."""
    if config not in _STAGE:
        torch.set_num_threads(1)
        library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
        library = library.of(config.people)
        scene = SceneData(texture=256, skirts=_SKIRTS, actors=_SAMS, loosened=_LOOSE)
        cast = Cast(load_body_model(), (load_actor("sam"),), library, scene)
        networks = tuple(OnnxDetector(find_model(name, DETECTORS)) for name in DEFAULT_DETECTORS)
        _STAGE[config] = cast, library.recordings, networks
    return _STAGE[config]


def _tracked(config: Experiment, number: int) -> Tracked | None:
    """One video's track; None where nobody was found in it."""
    cast, recordings, networks = _stage(config)
    rng = np.random.default_rng([config.seed, number])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        truth, camera = _film(path, cast, recordings, config, rng)
        clip = Clip.open(path)
        try:
            found = detect_clip(clip, Detecting(networks), camera)
        except InputError:
            return None
    return Tracked(
        found.joints2d[:, 0].numpy().astype(np.float32),
        found.confidence2d[:, 0].numpy().astype(np.float32),
        truth.numpy().astype(np.float32),
        camera.intrinsics[0].numpy().astype(np.float32),
    )


def _film(
    path: Path,
    cast: Cast,
    recordings: tuple[Recording, ...],
    config: Experiment,
    rng: np.random.Generator,
) -> tuple[Tensor, Camera]:
    """Write a video; its truth in camera axes (F, 16, 3), and its camera."""
    person = cast.person(rng)
    turns, way = _motion(cast, recordings, config, rng)
    poses = [cast.posed(person, turn) for turn in turns]
    marks = torch.stack([pose.landmarks for pose in poses])
    shift = (way - mid_hip(marks))[:, None]
    joints = (marks + shift).double()
    camera = standing_camera(joints, config.size, rng, _TILTS, LENSES)
    behind = torch.from_numpy(Backgrounds().draw(config.size, rng))
    lighting, _ = random_lighting(rng)
    texture = Texture.from_image(
        torch.from_numpy(person.figure.texture), *cast.texture_places(person)
    )
    grain = rng.uniform(0, 6)
    with VideoWriter(path, RATE / 2) as writer:
        for pose, moved in zip(poses, shift, strict=True):
            mesh = ProjectedMesh.seen_by(camera, pose.vertices + moved, pose.faces)
            image = render(mesh, texture, behind, lighting).image
            picture = image.reshape(config.size, config.size, 3).numpy()
            noisy = picture + rng.normal(0, grain, (config.size, config.size, 1))
            writer.write(np.ascontiguousarray(noisy.clip(0, 255).astype(np.uint8)))
    rotation, translation = camera.rotation[0], camera.translation[0]
    return joints @ rotation.mT + translation, camera


def _motion(
    cast: Cast, recordings: tuple[Recording, ...], config: Experiment, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Turns of joints (F, 16, 3, 3) and the middles of the hips (F, 3) of a random motion."""
    step = int(rng.choice(_STEPS))
    fitting = [r for r in recordings if len(r.turns) > step * config.frames]
    weights = np.sqrt([len(r.turns) for r in fitting])
    whose, other = (fitting[i] for i in rng.choice(len(fitting), 2, p=weights / weights.sum()))
    if rng.random() < config.hard:
        whose = exaggerated(whose, rng)
    parts = []
    for clip in (whose, other):
        start = int(rng.integers(len(clip.turns) - step * config.frames))
        parts.append(slice(start, start + step * config.frames, step))
    turns = whose.turns[parts[0]].clone()
    cast.vary(turns, other.turns[parts[1]], rng)
    return turns, mid_hip(whose.landmarks[parts[0]])


def _rows(made: list[Tracked]) -> tuple[tuple[object, ...], ...]:
    """Percent of the person's height in the picture, by landmark."""
    rows: list[tuple[object, ...]] = []
    for mark, name in enumerate(LANDMARKS):
        off = np.concatenate([_off(track)[:, mark] for track in made])
        rows.append((name, *(float(v) for v in np.nanquantile(off, (0.5, 0.9)))))
    return tuple(rows)


def _off(track: Tracked) -> NDArray[np.float64]:
    """(F, 16), NaN where unseen."""
    focal = track.intrinsics[0, 0]
    depth = track.truth[:, :, 2:]
    true = track.truth @ track.intrinsics.T
    apart = np.linalg.norm(track.joints2d - true[..., :2] / true[..., 2:], axis=-1)
    size = 1.65 * focal / depth.mean(1)
    return np.where(track.confidence > 0, 100 * apart / size, np.nan)


if __name__ == "__main__":
    report.main(run, Experiment, "filmed_tracks")
