"""Camera files with a pose a frame that are of another take, late, drift or zoom: what is named.

Videos are staged: people, rooms and ways of a camera in a hand, drawn at random. Their right files
are examined as well, before crowds and as a rolling shutter films them: what is named there is a
false alarm.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from hand_held import WAYS
from numpy.typing import NDArray
from recordings import rendered
from report import Report, Table, data_folder
from scipy.spatial.transform import Rotation, Slerp
from staged_people import RATE, staged
from torch import Tensor
from way_lengths import scaled_way

from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.clip import Clip, FrameReader
from perfcap.io.doctor.given_way import examine_way
from perfcap.pipeline.images import PartOfReader
from perfcap.train.motion_library import MotionLibrary

Image = NDArray[np.uint8]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_coat", "dev_tight", "dev_skirt")
    """Of the rendered set; cameras of the last two stand still, and have the same pose a frame."""
    clips: int = 8
    """Staged ones: people, rooms and ways drawn at random."""
    frames: int = 90
    """Of a staged clip."""
    size: int = 480
    """Of its pictures, pixels."""
    seed: int = 5
    """Of the staged clips; thresholds were chosen on seed 3 and dev_coat."""


@dataclass(frozen=True)
class Film:
    """A video, its camera of each frame (F, 1), and joints (F, 16, 2) with their confidence."""

    name: str
    reader: FrameReader
    camera: Camera
    joints: Array
    confidence: Array
    masks: NDArray[np.bool_] | None = None

    @property
    def moves(self) -> bool:
        """Whether the camera does."""
        return float(self.camera.rotation.std(0).max()) > 0


@dataclass(frozen=True)
class Painted:
    """Frames of one view that are changed as they are read."""

    inner: FrameReader
    change: Callable[[Image, int], Image]

    def __len__(self) -> int:
        return len(self.inner)

    def read_view(self, view: int, start: int, stop: int) -> Image:
        """Changed RGB frames, (stop - start, H, W, 3)."""
        images = self.inner.read_view(view, start, stop)
        return np.stack([self.change(each, start + k) for k, each in enumerate(images)])


def run(config: Experiment) -> Report:
    """A row a kind of file."""
    with tempfile.TemporaryDirectory() as scratch:
        films = list(_films(config, Path(scratch)))
        rows = [_row(kind, spoil, films) for kind, spoil in FILES.items()]
    columns = ("file", "videos", "named", "what is said beside, or not named")
    return Report((Table("given cameras that move", columns, tuple(rows)),), ())


def _films(config: Experiment, folder: Path) -> Iterator[Film]:
    for name in config.sequences:
        known = rendered(config.data, name)
        camera = known.cameras.every_frame(len(known.truth))
        seen = (known.detections.joints2d[:, 0], known.detections.confidence2d[:, 0])
        clip = Clip.open([str(known.folder / "video.mp4")])
        yield Film(name, clip, camera, *(part.double().numpy() for part in seen))
    if config.clips:
        library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    for number in range(config.clips):
        settings = config.frames, config.size, config.seed
        take = staged(folder, library, number, *settings, handling=WAYS[number % len(WAYS)])
        seen = (take.detections.joints2d[:, 0], take.detections.confidence2d[:, 0])
        parts = [part.double().numpy() for part in seen]
        yield Film(take.name, take.clip, take.cameras, parts[0], parts[1], take.masks)


def _row(kind: str, spoil: Spoil, films: list[Film]) -> tuple[str | float, ...]:
    """How many videos with such a file are named."""
    named, count, notes = 0, 0, []
    for index, film in enumerate(films):
        spoiled = spoil(film, films[index - 1])
        if spoiled is None:
            continue
        seen = spoiled.joints[:, None], spoiled.confidence[:, None]
        found = examine_way(spoiled.reader, (film.name,), spoiled.camera, RATE, seen)
        count, named = count + 1, named + len(found)
        beside = [each.what.split("; ")[1] for each in found if "; " in each.what]
        notes += beside if found else [f"not {film.name}"]
    several = {note: notes.count(note) for note in notes} if len(notes) <= count else {}
    return kind, count, named, "; ".join(f"{k} x {v}" if v > 1 else k for k, v in several.items())


# --- Right files, of videos that are hard to follow ----------------------------------------------

Spoil = Callable[[Film, Film], Film | None]


def _right(film: Film, _: Film) -> Film:
    return film


def _crowd(film: Film, _: Film) -> Film | None:
    """Copies of the person who walk about, each its own way, and are not known."""
    if film.masks is None:
        return None
    masks = film.masks
    rng = np.random.default_rng(0)
    height, width = masks.shape[1:]
    starts = rng.uniform(-0.45, 0.45, (9, 2)) * (width, 0.3 * height)
    steps = rng.uniform(-0.004, 0.004, (9, 2)) * width

    def crowded(image: Image, frame: int) -> Image:
        shown = image.copy()
        person, mask = image[:, ::-1].copy(), masks[frame, :, ::-1].astype(np.uint8)
        for start, step in zip(starts, steps, strict=True):
            shift = np.array([[1, 0, 0], [0, 1, 0]], float)
            shift[:, 2] = start + frame * step
            there = cv2.warpAffine(mask, shift, (width, height)) > 0
            shown[there] = cv2.warpAffine(person, shift, (width, height))[there]
        shown[masks[frame]] = image[masks[frame]]
        return np.asarray(shown)

    return replace(film, reader=Painted(film.reader, crowded))


def _shutter(seconds: float) -> Spoil:
    """A shutter that takes so long from the first line of an image to the last."""

    def spoil(film: Film, _: Film) -> Film:
        (height, width), turns = film.camera.size[0], film.camera.rotation[:, 0].double().numpy()
        every = Slerp(np.arange(len(turns)), Rotation.from_matrix(turns))
        lens = film.camera.intrinsics[0, 0].double().numpy()
        column, row = np.meshgrid(np.arange(width), np.arange(height))
        rays = np.stack((column, row, np.ones_like(row)), -1) @ np.linalg.inv(lens).T

        def rolled(image: Image, frame: int) -> Image:
            late = seconds * RATE * (np.arange(height) / height - 0.5)
            then = every(np.clip(frame + late, 0, len(turns) - 1)).as_matrix()
            back = lens @ turns[frame] @ then.transpose(0, 2, 1)
            seen = np.einsum("rij,rcj->rci", back, rays)
            place = (seen[..., :2] / seen[..., 2:]).astype(np.float32)
            return np.asarray(
                cv2.remap(image, place[..., 0], place[..., 1], cv2.INTER_LINEAR,
                          borderMode=cv2.BORDER_REPLICATE), np.uint8)  # fmt: skip

        return replace(film, reader=Painted(film.reader, rolled)) if film.moves else film

    return spoil


def _trembling(degrees: float, metres: float) -> Spoil:
    """Poses with errors of each frame's own."""

    def spoil(film: Film, _: Film) -> Film:
        generator = torch.Generator().manual_seed(0)
        noise = torch.randn(2, len(film.camera.rotation), 1, 3, generator=generator).double()
        return _posed(film, math.radians(degrees) * noise[0], metres * noise[1])

    return spoil


# --- Wrong files ----------------------------------------------------------------------------------


def _posed(film: Film, turn: Tensor, shift: Tensor) -> Film:
    """Cameras turned by rotation vectors and shifted, both in their own axes, (F, 1, 3)."""
    camera = film.camera
    matrix = rotvec_to_matrix(turn).to(camera.rotation)
    moved = (matrix @ camera.translation[..., None])[..., 0] + shift.to(camera.translation)
    return replace(
        film, camera=replace(camera, rotation=matrix @ camera.rotation, translation=moved)
    )


def _drifts(degrees: float, metres: float) -> Spoil:
    """Poses that go wrong evenly, by so much a second."""

    def spoil(film: Film, _: Film) -> Film:
        time = torch.arange(len(film.camera.rotation)).double()[:, None, None] / RATE
        turn = math.radians(degrees) * time * torch.tensor([0.3, 0.9, 0.3]).double()
        return _posed(film, turn, metres * time * torch.tensor([1.0, 0.0, 0.0]).double())

    return spoil


def _zooms(factor: float) -> Spoil:
    """Pictures that grow by so much until the end, of cameras whose file has one lens."""

    def spoil(film: Film, _: Film) -> Film:
        height, width = film.camera.size[0]
        middle = 0.5 * np.array([width - 1, height - 1])
        growth = np.geomspace(1, factor, len(film.reader))

        def grown(image: Image, frame: int) -> Image:
            matrix = np.column_stack((np.eye(2) * growth[frame], (1 - growth[frame]) * middle))
            return np.asarray(cv2.warpAffine(image, matrix, (width, height)), np.uint8)

        joints = middle + growth[: len(film.joints), None, None] * (film.joints - middle)
        return replace(film, reader=Painted(film.reader, grown), joints=joints)

    return spoil


def _of_frames(choose: Callable[[Tensor], Tensor]) -> Spoil:
    """Poses of other frames of the same file."""

    def spoil(film: Film, _: Film) -> Film | None:
        frames = choose(torch.arange(len(film.camera.rotation)))
        return replace(film, camera=film.camera.frames(frames)) if film.moves else None

    return spoil


def _late(count: int) -> Spoil:
    return _of_frames(lambda frames: (frames + count).clamp(0, len(frames) - 1))


def _of_another(film: Film, other: Film) -> Film | None:
    """The way of the video before, repeated where it is shorter."""
    if not other.moves:
        return None
    count = len(film.camera.rotation), len(other.camera.rotation)
    camera = other.camera.frames(torch.arange(count[0]) % count[1])
    return replace(film, camera=replace(film.camera, rotation=camera.rotation.double(),
                                        translation=camera.translation.double()))  # fmt: skip


def _longer(factor: float) -> Spoil:
    """A lens that is longer than the true one."""

    def spoil(film: Film, _: Film) -> Film | None:
        lens = film.camera.intrinsics.clone()
        lens[..., :2, :2] *= factor
        return replace(film, camera=replace(film.camera, intrinsics=lens)) if film.moves else None

    return spoil


def _scaled(factor: float) -> Spoil:
    """A way that is longer than the true one, all else alike."""

    def spoil(film: Film, _: Film) -> Film | None:
        return replace(film, camera=scaled_way(film.camera, factor)) if film.moves else None

    return spoil


def _short(spoil: Spoil) -> Spoil:
    """The same of the second second of a film alone."""

    def cut(film: Film) -> Film:
        part = slice(round(RATE), round(2 * RATE))
        return replace(
            film,
            reader=PartOfReader(film.reader, part.start, part.stop),
            camera=film.camera.frames(part),
            joints=film.joints[part],
            confidence=film.confidence[part],
            masks=None if film.masks is None else film.masks[part],
        )

    return lambda film, other: spoil(cut(film), cut(other))


FILES: dict[str, Spoil] = {
    "right": _right,
    "right, before nine people who are not known": _crowd,
    "right, of a shutter of 15 ms": _shutter(0.015),
    "right, of a shutter of 30 ms": _shutter(0.030),
    "poses tremble by 0.05 degrees and 5 mm": _trembling(0.05, 0.005),
    "drifts by 1 degree a second": _drifts(1.0, 0.0),
    "drifts by 0.3 degrees a second": _drifts(0.3, 0.0),
    "drifts by 0.3 m a second": _drifts(0.0, 0.3),
    "the picture zooms by 1.3": _zooms(1.3),
    "the picture zooms by 1.1": _zooms(1.1),
    "runs backwards": _of_frames(lambda frames: frames.flip(0)),
    "ten frames late": _late(10),
    "three frames early": _late(-3),
    "a frame late": _late(1),
    "of another take": _of_another,
    "stands still": _of_frames(torch.zeros_like),
    "the first 24 poses are the same": _of_frames(lambda frames: frames.clamp(min=24)),
    "right, a second of it": _short(_right),
    "poses tremble, a second of it": _short(_trembling(0.05, 0.005)),
    "runs backwards, a second of it": _short(_of_frames(lambda frames: frames.flip(0))),
    "ten frames late, a second of it": _short(_late(10)),
    "of another take, a second of it": _short(_of_another),
    "a lens 1.5 times as long": _longer(1.5),
    "a way 2 times as long": _scaled(2.0),
    "a way 0.3 times as long": _scaled(0.3),
}

if __name__ == "__main__":
    report.main(run, Experiment, "given_cameras")
