"""Whether one person is followed through videos in which others are near, by the shipped networks.

Each person of each view of recordings of several people, whom a box says in the first frame, and
people whom others pass in films made here. With and without the network that tells people apart.
Truth is used to score alone, but for the boxes.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
import torch
from crossed_films import crossed_films
from numpy.typing import NDArray
from people_takes import people_of
from report import Report, Table, data_folder
from torch import Tensor

from perfcap.commands.views import DEFAULT_DETECTORS, FINDER
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.people import OnnxFinder
from perfcap.detect.person import Start, follow_person
from perfcap.errors import InputError
from perfcap.io.actor import models_folder
from perfcap.io.calibration import read_cameras
from perfcap.io.clip import Clip
from perfcap.train.motion_library import MotionLibrary

_SEEN = 0.3  # confidence from which a joint says who is followed
_FEWEST = 4  # such joints
_NEARER = 0.6  # of the distance to the person's own joints: those of who is followed instead
_MARGIN = 0.08  # of the larger side of the joints' box, that a box is wider


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings, with mocap_cmu_library in it."""
    sequences: tuple[str, ...] = ("dev_duo", "dev_trio", "dev_twins")
    """Of rendered_multi."""
    films: int = 24
    """Made here."""
    frames: int = 60
    """Of each film."""
    size: int = 448
    """Of its square pictures, pixels."""
    seed: int = 13
    """Of the films."""


@dataclass(frozen=True)
class _Video:
    """Frames, and the pixels of K people's joints in them, (K, F, 16, 2); whom to follow."""

    frames: Sequence[NDArray[np.uint8]]
    joints2d: Tensor
    people: tuple[int, ...]


def run(config: Experiment) -> Report:
    """One row for each take, and one for the films, with each way of following."""
    folder = models_folder() / "detectors"
    network = OnnxDetector(folder / DEFAULT_DETECTORS[0])
    watcher = OnnxFinder(folder / FINDER)
    rows: list[tuple[object, ...]] = []
    sets = [(name, list(_views(config.data, name))) for name in config.sequences]
    if config.films:
        sets.append(("films", list(_films(config))))
    for name, videos in sets:
        rows += [
            (name, told is not None, *_scores(network, told, videos)) for told in (None, watcher)
        ]
    columns = ("set", "told apart", "people", "right", "of another", "nobody", "CPU ms a frame")
    notes = (
        "people: those whom the box found in the first frame. right, of another: frames, %, in "
        "which the joints found are nearer to the person's own than to anybody else's, and not; "
        "nobody: in which none are found, hidden or not.",
    )
    return Report((Table("one of several people, followed", columns, tuple(rows)),), notes)


def _views(data: Path, name: str) -> Iterator[_Video]:
    people = people_of(data, name)
    folder = people[0].folder
    clip = Clip.open(sorted((folder / "views").glob("*.mp4")))
    cameras = read_cameras(folder / "cameras.json", clip.sizes).cameras
    seen = torch.stack([cameras.project(each.truth.to(cameras.rotation)) for each in people])
    for view in range(clip.views):
        frames = clip.read_view(view, 0, len(clip))
        yield _Video(list(frames), seen[:, : len(clip), view], tuple(range(len(people))))


def _films(config: Experiment) -> Iterator[_Video]:
    library = MotionLibrary.read(data_folder(config.data) / "mocap_cmu_library")
    films = crossed_films(library, config.films, config.frames, config.size, config.seed)
    for film in films:
        yield _Video(film.frames, film.joints2d, (0,))


def _scores(
    network: OnnxDetector, watcher: OnnxFinder | None, videos: Sequence[_Video]
) -> tuple[float, ...]:
    """How many people were found, percentages of their frames, and the time."""
    shares, spent, frames = [], 0.0, 0
    for video in videos:
        for person in video.people:
            began = time.process_time()
            share = _followed(network, watcher, video, person)
            spent += time.process_time() - began
            frames += len(video.frames)
            if share is not None:
                shares.append(share)
    found = np.mean(shares, 0).tolist() if shares else [float("nan")] * 3
    return (len(shares), *(100 * each for each in found), 1e3 * spent / frames)


def _followed(
    network: OnnxDetector, watcher: OnnxFinder | None, video: _Video, person: int
) -> tuple[float, float, float] | None:
    """Shares of right frames, of those of another, and of none; None if the first is not right."""
    truth = video.joints2d.float()
    low, high = truth[person, 0].amin(0), truth[person, 0].amax(0)
    grow = _MARGIN * float((high - low).max())
    left, top, right, bottom = torch.cat((low - grow, high + grow)).tolist()
    start = Start((left, top, right, bottom), watcher=watcher)
    try:
        found = follow_person(network, iter(video.frames), start)
    except InputError:  # nobody is seen there
        return None
    right_ones, wrong = [], []
    for frame in range(len(video.frames)):
        seen = found.confidence2d[frame, 0] > _SEEN
        there = int(seen.sum()) >= _FEWEST
        off = (truth[:, frame] - found.joints2d[frame, 0]).norm(dim=-1)[:, seen]
        middle = off.median(-1).values if there else torch.full((len(truth),), torch.inf)
        another = there and bool(middle.min() < _NEARER * middle[person])
        right_ones.append(there and not another)
        wrong.append(another)
    if not right_ones[0]:
        return None
    share, of_another = float(np.mean(right_ones)), float(np.mean(wrong))
    return share, of_another, 1 - share - of_another


if __name__ == "__main__":
    report.main(run, Experiment, "followed_person")
