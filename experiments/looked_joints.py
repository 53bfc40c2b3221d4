"""Joints that are late, or of the other side, in their video: how often looks of a network show it.

Stretches of 24 frames and whole clips, each view alone, joints of a network or simulated ones with
the frames of other times: as they are, some frames late and early, and with left and right
exchanged. What is named of the first is a false alarm. Joints of other recordings whose images are
as large; all views, the videos of two of them exchanged. Joints of pictures that were resized or
moved, of one person and of all of several, and of several people of another recording. The network
is the one that ``perfcap doctor`` and captures look with.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path

import numpy as np
import report
import torch
from numpy.typing import NDArray
from recordings import Recording, balancing, demo, rendered, rendered_views
from report import Report, Table
from torch import Tensor

from perfcap.detect.known_person import OPPOSITE
from perfcap.io.calibration.pixel_map import read_pixel_map
from perfcap.io.doctor.looked import examine_looks
from perfcap.io.video import VideoFile

_Seen = tuple[VideoFile, Tensor, Tensor]
_SEVERAL = (("dev_views", 1), ("dev_dance", 1), ("dev_duo", 2), ("dev_trio", 3), ("dev_twins", 2))


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    stretch: int = 24
    """Frames of the stretches."""
    late: tuple[int, ...] = (3, 5, 10)
    """Frames by which joints are late, and early."""
    views: int = 4
    """Most views of a recording."""
    resized: tuple[float, ...] = (0.9, 0.94, 0.97, 1.05)
    """Times the rows by which pictures were resized."""
    moved: int = 30
    """Pixels by which pictures were moved down."""


@dataclass(frozen=True)
class _View:
    """The video of one view from some frame on; ``Frames`` of one view."""

    file: VideoFile
    start: int
    count: int

    def __len__(self) -> int:
        return self.count

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        return self.file.read(self.start + start, self.start + stop)


@dataclass(frozen=True)
class _Views:
    """The videos of several views."""

    files: Sequence[VideoFile]

    def __len__(self) -> int:
        return min(len(file) for file in self.files)

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        return self.files[view].read(start, stop)


def run(config: Experiment) -> Report:
    """A row for each recording."""
    torch.set_num_threads(1)
    clips = [(clip, list(_views(clip, config.views))) for clip in _recordings(config.data)]
    rows = [_row(clip.name, views, config) for clip, views in clips]
    counts = np.array([row[1:] for row in rows]).sum(0).tolist()
    columns = ["recording", "inputs", "named of right ones", "exchanged: named"]
    columns += [f"{count} frames off: named" for count in config.late]
    columns += [f"{count} off: the right way" for count in config.late]
    title = "joints of other frames or sides than the video shows"
    seen = Table(title, tuple(columns), (*rows, ("all", *counts)), 0)
    return Report(
        (
            seen,
            _of_others(clips),
            _in_other_order(clips),
            _of_resized(clips, config),
            _of_people(config),
        )
    )


def _recordings(data: Path) -> Iterator[Recording]:
    yield from (rendered(data, name) for name in ("dev_tight", "dev_skirt", "dev_coat"))
    yield demo()
    for name, people in _SEVERAL:
        yield from (rendered_views(data, name, person) for person in range(1, people + 1))
    yield balancing(data)


def _of_others(clips: Sequence[tuple[Recording, Sequence[_Seen]]]) -> Table:
    """How often joints of another recording are named in the first views of each."""
    rows = []
    for clip, views in clips:
        said = []
        for (file, *_), other in product(views[:2], clips):
            if other[0].folder == clip.folder:
                continue  # somebody else of the same video
            for theirs, joints, confidence in other[1][:2]:
                if theirs.size == file.size:
                    count = range(min(len(joints), 36))
                    said.append(bool(_said(file, joints, confidence, count, 0)))
        rows.append((clip.name, len(said), sum(said)))
    return Table("joints of other recordings", ("video", "inputs", "named"), tuple(rows), 0)


def _in_other_order(clips: Sequence[tuple[Recording, Sequence[_Seen]]]) -> Table:
    """How often two of all views are named whose videos are exchanged, and views that are right."""
    rows = []
    for clip, views in clips:
        joints, confidence = (torch.cat(each, 1) for each in list(zip(*views, strict=True))[1:])
        names = [str(view) for view in range(len(views))]
        both = one = others = 0
        pairs = list(combinations(range(len(views)), 2))
        for pair in pairs:
            order = list(range(len(views)))
            order[pair[0]], order[pair[1]] = pair[1], pair[0]
            files = _Views([views[view][0] for view in order])
            found = examine_looks(files, confidence, joints, names)
            told = [each.subject for each in found if "another video" in each.what]
            low = {int(view) for subject in told for view in subject.split(", ")}
            both += low >= set(pair)
            one += len(low & set(pair)) == 1
            others += len(low - set(pair))
        if pairs:
            rows.append((clip.name, len(pairs), both, one, others))
    columns = ("recording", "pairs of views", "both named", "one named", "others named")
    return Table("views whose videos are exchanged", columns, tuple(rows), 0)


def _of_resized(clips: Sequence[tuple[Recording, Sequence[_Seen]]], config: Experiment) -> Table:
    """How often joints of a resized or moved picture are named, in stretches of single views."""
    rows = []
    for clip, views in clips:
        said = []
        for file, joints, confidence in views:
            last = len(joints) - config.stretch
            for first in range(0, last, max(config.stretch, last // 2)):
                part = range(first, first + config.stretch)
                given = _wrong_rows(joints, config)
                said.append([bool(_said(file, each, confidence, part, 0)) for each in given])
        rows.append((clip.name, len(said), *np.array(said).sum(0).tolist()))
    title = "joints of resized and moved pictures: named"
    return Table(title, ("recording", "inputs", *_rows_named(config)), tuple(rows), 0)


def _wrong_rows(joints: Tensor, config: Experiment) -> Iterator[Tensor]:
    """Joints (..., 2) as they are, in pictures of so many times the rows, and moved down."""
    for scale in (1.0, *config.resized):
        yield joints * joints.new_tensor([1.0, scale])
    yield joints + joints.new_tensor([0.0, config.moved])


def _rows_named(config: Experiment) -> list[str]:
    return ["right", *(f"rows x {scale:g}" for scale in config.resized), f"{config.moved} px down"]


def _of_people(config: Experiment) -> Table:
    """The same of each of several people whose joints are all given; and of another recording."""
    takes = {}
    for name in ("dev_duo", "dev_trio", "dev_twins"):
        folders = sorted((config.data / "rendered_multi" / name).glob("person*"))
        clips = [rendered_views(config.data, name, k) for k in range(1, len(folders) + 1)]
        views = list(zip(*(_views(clip, config.views) for clip in clips), strict=True))
        takes[name] = [
            (view[0][0], torch.stack([v[1] for v in view]), torch.stack([v[2] for v in view]))
            for view in views
        ]
    rows = []
    for (name, views), (other, theirs) in product(takes.items(), takes.items()):
        said: list[tuple[bool, ...]] = []
        for (file, *own), (_, *strange) in zip(views, theirs, strict=False):
            joints, confidence = own if name == other else strange
            given = _wrong_rows(joints, config) if name == other else [joints]
            said += zip(
                *(_people_said(file, each, confidence, config) for each in given), strict=True
            )
        counts = np.array(said).sum(0).tolist()
        counts += ["-"] * (len(_rows_named(config)) - len(counts))
        rows.append((name, other, len(said), *counts))
    title = "joints of all of several people: named, of other recordings without changes"
    columns = ("video", "joints", "people in views", *_rows_named(config))
    return Table(title, columns, tuple(rows), 0)


def _people_said(
    file: VideoFile, joints: Tensor, confidence: Tensor, config: Experiment
) -> list[bool]:
    """Whether something is said of each person of joints (P, F, 1, 16, 2)."""
    count = min(config.stretch, joints.shape[1])
    joints, confidence = joints[:, :count], confidence[:, :count]
    shown = _View(file, 0, count)
    return [
        bool(examine_looks(shown, sure, own, everybody=(joints, confidence)))
        for own, sure in zip(joints, confidence, strict=True)
    ]


def _row(name: str, views: Sequence[_Seen], config: Experiment) -> tuple[str | int, ...]:
    right, sides, named, way = [], [], {n: 0 for n in config.late}, {n: 0 for n in config.late}
    for file, joints, confidence in views:
        count = len(joints)
        least = max(config.late) + config.stretch
        parts = [range(a, a + config.stretch) for a in range(0, count - least, config.stretch)]
        for part in (*parts, range(count)):
            right.append(bool(_said(file, joints, confidence, part, 0)))
            other = joints[..., OPPOSITE, :], confidence[..., OPPOSITE]
            sides.append("left and right" in _said(file, *other, part, 0))
            for late in config.late:
                for shift in (late, -late):
                    said = _said(file, joints, confidence, part, shift)
                    named[late] += bool(said)
                    way[late] += ("late" if shift > 0 else "early") in said
    return (name, len(right), sum(right), sum(sides), *named.values(), *way.values())


def _views(clip: Recording, most: int) -> Iterator[_Seen]:
    """Video, joints in its pixels (F, 1, 16, 2) and their confidence (F, 1, 16), of each view."""
    files = sorted([*clip.folder.glob("views/*.mp4"), *clip.folder.glob("videos/*.mp4")])
    known = clip.folder / "video_to_native.json"
    maps = [each for _, each in sorted(read_pixel_map(known).items())] if known.is_file() else []
    if not files:
        files = [clip.folder / "video.mp4"]
    for view, path in enumerate(files[:most]):
        seen = clip.detections.select([view])
        joints = seen.joints2d.double()
        if maps:
            back = torch.linalg.inv(torch.as_tensor(maps[view]).double())
            joints = joints @ back[:2, :2].mT + back[:2, 2]
        yield VideoFile(path), joints, seen.confidence2d


def _said(file: VideoFile, joints: Tensor, confidence: Tensor, part: range, shift: int) -> str:
    """What is said of a part of a clip whose joints are late by some frames."""
    first, stop = max(part.start, -shift), min(part.stop, len(joints) - shift)  # of the joints
    if part.start + shift >= 0 and part.stop + shift <= len(joints):
        first, stop = part.start, part.stop
    index = slice(first, stop)
    shown = _View(file, first + shift, stop - first)
    found = examine_looks(shown, confidence[index], joints[index])
    return found[0].what if found else ""


if __name__ == "__main__":
    report.main(run, Experiment, "looked_joints")
