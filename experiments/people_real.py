"""Who is where in a real recording with a second person put into it, against outlines by hand.

``pose2sim_multi`` is ``pose2sim_balancing`` with a woman rendered into it, so that the outlines of
the man that were drawn by hand in the latter (``tests/labels``) are his in the former, too. Its
videos are rescaled, about a frame later, and slip against each other in their second half: an
outline counts only where the pixels around it are those of a frame of the other video.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from numpy.typing import NDArray
from people_association import matched
from people_takes import pose2sim
from recordings import stored_image
from report import Report, Table, data_folder

from perfcap.app.capture import run_capture
from perfcap.commands.capture import Capture
from perfcap.detect.association import associate
from perfcap.detect.detections import Detections
from perfcap.io.actor import load_actor
from perfcap.io.clip import Clip
from perfcap.io.datasets import find_dataset
from perfcap.io.mask_files import fill, read_labels
from perfcap.metrics import joint_errors, mask_overlap
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.people import Person, Scene

Mask = NDArray[np.bool_]
Labels = NDArray[np.uint8]

_DRAWN = Path(__file__).parents[1] / "tests" / "labels" / "pose2sim_balancing"
_LATER = range(-1, 4)  # frames by which the composite may be later
_ALIKE = 0.97  # correlation of the pixels around an outline; the next frames have 0.9
_AROUND = 7  # px
_MAN = 1  # of the answer key
_HAND = 3.0  # px by which an outline by hand may be off


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    captured: Path | None = None
    """Result of `perfcap capture ... --people 2` of all 60 frames; made anew if not given."""
    outlines: bool = True
    """Score who is where; only the man's joints, from detections of everybody, if not."""


@dataclass(frozen=True)
class _Drawn:
    """The man in a frame of the composite, by hand."""

    view: int
    frame: int
    mask: Mask


def run(config: Experiment) -> Report:
    """Both tables."""
    joints = _joints(config.data)
    if not config.outlines:
        return joints
    masks = _masks(config)
    return Report(masks.tables + joints.tables, masks.notes + joints.notes)


def _joints(data: Path) -> Report:
    """The man's, from detections that the answer key gives to him, and from those of everybody."""
    crowd = pose2sim(data)
    name = "pose2sim_multi/reference3d_scene_calib_man"
    truth = find_dataset("pose2sim").read(data_folder(data), name).joints3d
    assert truth is not None
    slots = torch.from_numpy((crowd.owner == _MAN).argmax(0))
    there = torch.from_numpy((crowd.owner == _MAN).any(0))
    every = torch.arange(slots.shape[0])[:, None], torch.arange(slots.shape[1])
    seen, sure = (
        crowd.candidates.joints2d[(slots, *every)],
        crowd.candidates.confidence2d[(slots, *every)],
    )
    own = Detections.from_joints(seen, sure.where(there[..., None], 0.0))
    actor = load_actor("sam")
    alone = capture(actor, crowd.cameras, own, crowd.rate)
    found = associate(crowd.cameras, crowd.candidates, crowd.rate)
    (number,) = [k for k, person in matched(crowd, found.slots)[1] if person == _MAN]
    cast = tuple(Person(actor, each) for each in found.people)
    among = capture(Scene(crowd.cameras, cast, crowd.rate))[number]
    rows: list[tuple[str, float, float, float]] = []
    for label, each in (("alone", alone), ("among others", among)):
        joints = each.joints()
        apart = 1000 * (joints - truth[: len(joints)]).norm(dim=-1)
        e = joint_errors(joints, truth[: len(joints)], crowd.rate)
        rows.append((label, float(apart.nanmean()), float(e.mpjpe_root), float(e.mpjpe_similarity)))
    one, two, three = (b / a for a, b in zip(rows[0][1:], rows[1][1:], strict=True))
    rows.append(("ratio", one, two, three))
    columns = ("detections", "absolute", "about the root", "after a similarity")
    note = "The truth is triangulated from the same detections, good to some centimetres."
    return Report((Table("the man's joints, mm", columns, tuple(rows), 2),), (note,))


def _masks(config: Experiment) -> Report:
    folder = data_folder(config.data) / "pose2sim_multi"
    with tempfile.TemporaryDirectory() as place:
        out = config.captured
        if out is None:
            out = Path(place) / "out"
            run_capture(_request(folder, out))
        drawn, outlines = [], 0
        for view in range(4):
            found = list(_outlines(config.data, view))
            outlines += len(found)
            drawn += [each for each in found if each is not None]
        labels = [_labels(out, each) for each in drawn]
    rows = [_row(f"cam0{view + 1}", drawn, labels, (view,)) for view in range(4)]
    rows.append(_row("all", drawn, labels, tuple(range(4))))
    columns = ("view", "outlines", "right", "nobody", "woman", "right of given", "IoU",
               "right, 3 px inside", "outlines with hers")  # fmt: skip
    return Report(
        (Table("the man, % of his pixels", columns, tuple(rows), 2),),
        (f"{len(drawn)} of {outlines} outlines can be carried into the composite.",),
    )


def _request(folder: Path, out: Path) -> Capture:
    """The command of docs/people.md without surfaces: networks follow two people."""
    return Capture(
        videos=tuple(sorted((folder / "videos").glob("*.mp4"))),
        cameras=folder / "calibration" / "Calib_scene.toml",
        video_map=folder / "video_to_native.json",
        actor=("sam",), people=2, frames="0:60", overlay=False, until="refine_pose", out=out,
    )  # fmt: skip


def _outlines(data: Path, view: int) -> Iterator[_Drawn | None]:
    """Outlines of a view in the pixels and frames of the composite; None where none fits."""
    folders = [data_folder(data) / name for name in ("pose2sim_multi", "pose2sim_balancing")]
    name = f"cam0{view + 1}"
    clips = [Clip.open([folder / "videos" / f"{name}.mp4"]) for folder in folders]
    gray = [
        [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in clip.read_view(0, 0, len(clip))]
        for clip in clips
    ]
    maps = [_to_native(folder / "video_to_native.json", name) for folder in folders]
    across = (np.linalg.inv(maps[0]) @ maps[1])[:2]
    size = gray[0][0].shape
    for frame, lines in read_labels(_DRAWN / f"{name}.json", gray[1][0].shape).items():
        mask = fill(lines, gray[1][0].shape).astype(np.uint8)
        moved = cv2.warpAffine(mask, across, size[::-1], flags=cv2.INTER_NEAREST) > 0
        kernel = np.ones((2 * _AROUND + 1,) * 2, np.uint8)
        around = cv2.dilate(moved.astype(np.uint8), kernel) > 0
        known = cv2.warpAffine(gray[1][frame], across, size[::-1], flags=cv2.INTER_CUBIC)[around]
        shown = [f for f in (frame + later for later in _LATER) if 0 <= f < min(len(gray[0]), 60)]
        alike = [float(np.corrcoef(known, gray[0][f][around])[0, 1]) for f in shown]
        best = int(np.argmax(alike))
        yield _Drawn(view, shown[best], moved) if alike[best] > _ALIKE else None


def _to_native(path: Path, name: str) -> NDArray[np.float64]:
    """(3, 3), from a video's pixels to those of its calibration."""
    rows = json.loads(path.read_text())["video_px_to_native_px"][name]
    return np.vstack([np.array(rows, np.float64)[:2], [0, 0, 1]])


def _labels(out: Path, drawn: _Drawn) -> Labels:
    folder = sorted((out / "masks").iterdir())[drawn.view]
    labels = stored_image(folder / f"{drawn.frame:06d}.png")
    assert labels is not None
    return np.asarray(labels if labels.ndim == 2 else labels[..., 0], np.uint8)


def _row(
    name: str, drawn: list[_Drawn], labels: list[Labels], views: tuple[int, ...]
) -> tuple[object, ...]:
    """Of all outlines together; the man is whom most of his pixels are given to."""
    counts = sum(
        np.bincount(found[each.mask], minlength=3)[:3]
        for each, found in zip(drawn, labels, strict=True)
    )
    man = int(np.argmax(np.asarray(counts)[1:])) + 1
    chosen = [pair for pair in zip(drawn, labels, strict=True) if pair[0].view in views]
    total = right = nobody = other = sure = sure_right = 0
    overlaps = []
    for each, found in chosen:
        inside = found[each.mask]
        total += inside.size
        right += int((inside == man).sum())
        nobody += int((inside == 0).sum())
        other += int((inside == 3 - man).sum())
        deep = cv2.distanceTransform(each.mask.astype(np.uint8), cv2.DIST_L2, 5) > _HAND
        sure += int(deep.sum())
        sure_right += int((found[deep] == man).sum())
        overlaps.append(mask_overlap(found == man, each.mask).iou)
    part = [100 * value / max(total, 1) for value in (right, nobody, other)]
    given, iou = 100 * right / max(right + other, 1), 100 * float(np.mean(overlaps))
    frames = sum(bool((found[each.mask] == 3 - man).any()) for each, found in chosen)
    return (name, len(chosen), *part, given, iou, 100 * sure_right / max(sure, 1), frames)


if __name__ == "__main__":
    report.main(run, Experiment, "people_real")
