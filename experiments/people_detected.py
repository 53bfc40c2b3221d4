"""Several people found in videos by networks: whose joints they get, and captures made of these.

Nothing is given but videos, cameras and the number of people. ``pose2sim_multi`` has a truth of the
man alone, triangulated from other detections, good to some centimetres; the woman beside him was
rendered. Truth is used to score alone.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
import torch
from people_takes import people_of
from recordings import Recording
from report import Report, Table, data_folder
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.app.inputs import Inputs, read_inputs
from perfcap.commands.capture import Capture
from perfcap.commands.views import DEFAULT_DETECTORS, FINDER
from perfcap.detect.association import associate
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.actor import load_actor
from perfcap.io.datasets import find_dataset
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.people import Person, Scene

_PCK = 0.2
_OTHERS = ("head_top", "neck", "r_toe", "l_toe")
_TWELVE = [i for i, name in enumerate(LANDMARKS) if name not in _OTHERS]
_TORSO = LANDMARKS.index("l_shoulder"), LANDMARKS.index("r_hip")
_SEEN = 0.3  # confidence from which a joint says whom a view shows
_REAL = "pose2sim_multi"


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_duo", "dev_trio", "dev_twins", _REAL)
    """Of ``rendered_multi``, and the real one."""
    networks: tuple[str, ...] = (
        "+".join(DEFAULT_DETECTORS),
        "+".join((FINDER, *DEFAULT_DETECTORS)),
    )
    """Each several networks with + between."""
    views: tuple[int, ...] = ()
    """Cameras to use, counted from 0; all if none are given."""
    captured: bool = True
    """Also capture everybody, without images."""


@dataclass(frozen=True)
class _Take:
    """Videos of people, and the truth about K of them: (K, F, 16, 3) m, and what views show."""

    folder: Path
    cameras: Path
    count: int
    truth: Tensor
    visible: Tensor
    actors: tuple[Actor, ...]
    video_map: Path | None = None


def run(config: Experiment) -> Report:
    """One row for each take and person."""
    rows = [
        row for name in config.sequences for text in config.networks
        for row in _rows(config, name, text)
    ]  # fmt: skip
    columns = ("take", "networks", "person", "found", "seen", "of another", "mm", "CPU ms")
    notes = (
        "found: of the 12 joints that a view shows, % nearer than a fifth of the torso. seen: "
        "frames and views with joints of the person, %. of another: of these, % in which the "
        "joints are nearer to another person's. mm: mean joint error of a capture of everybody "
        "without images. CPU ms: of all networks, a frame and view.",
    )
    return Report((Table("people found in videos", columns, tuple(rows)),), notes)


def _rows(config: Experiment, name: str, text: str) -> list[tuple[object, ...]]:
    take = _take(config.data, name)
    request = _request(take, tuple(text.split("+")), config.views)
    began = time.process_time()
    inputs = read_inputs(request)
    views, frames = inputs.clip.views, len(inputs.clip)
    spent = 1000 * (time.process_time() - began) / (views * frames)
    cameras, rate = inputs.rig.cameras, inputs.clip.fps
    found = associate(cameras, inputs.detections, rate, people=take.count)
    truth = torch.stack([cameras.project(each[:frames]) for each in take.truth])  # K F C 16 2
    chosen = list(config.views) or list(range(views))
    visible = take.visible[:, :frames, chosen]
    apart = torch.stack([_apart(each, truth) for each in found.people])  # P K F C
    near = apart.nan_to_num(nan=torch.inf).clamp(max=1e3).mean((2, 3))
    slots, people = linear_sum_assignment(near.numpy())
    errors = _captured(take, inputs, [found.people[p] for p in slots], people, config.captured)
    rows: list[tuple[object, ...]] = []
    for p, k, error in sorted(zip(slots, people, errors, strict=True), key=lambda row: row[1]):
        hits = _hits(found.people[p], truth[k])[visible[k]]
        own = apart[p, k]
        there = own.isfinite()
        wrong = (apart[p].nan_to_num(nan=torch.inf).amin(0) < own)[there]
        numbers = (hits.double().mean(), there.double().mean(), wrong.double().mean())
        rows.append((name, text, int(k) + 1, *(100 * float(v) for v in numbers), error, spent))
    return rows


def _take(data: Path, name: str) -> _Take:
    if name != _REAL:
        people = people_of(data, name)
        first = people[0]
        truth = torch.stack([each.truth for each in people])
        shown = torch.stack([_visible(each) for each in people])
        actors = tuple(each.actor for each in people)
        cameras = first.folder / "cameras.json"
        return _Take(first.folder / "views", cameras, len(people), truth, shown, actors)
    folder = data_folder(data) / name
    man = find_dataset("pose2sim").read(data_folder(data), f"{name}/reference3d_scene_calib_man")
    assert man.joints3d is not None
    truth = man.joints3d[None]
    known = truth.isfinite().all(-1)[:, :, None].expand(-1, -1, 4, -1)[..., _TWELVE]
    cameras = folder / "calibration" / "Calib_scene.toml"
    video_map = folder / "video_to_native.json"
    return _Take(folder / "videos", cameras, 2, truth, known, (load_actor("sam"),), video_map)


def _visible(person: Recording) -> Tensor:
    assert person.sequence is not None
    with np.load(person.sequence.folder / "gt.npz", allow_pickle=False) as truth:
        return torch.from_numpy(truth["joint_visible"]).bool()[..., _TWELVE]


def _request(take: _Take, networks: tuple[str, ...], views: Sequence[int]) -> Capture:
    videos = sorted(take.folder.glob("*.mp4"))
    chosen = tuple(videos[c] for c in views) if views else tuple(videos)
    return Capture(
        videos=chosen,
        cameras=take.cameras,
        people=take.count,
        detector=networks,
        video_map=take.video_map,
    )


def _apart(found: Detections, truth: Tensor) -> Tensor:
    """Mean distance of seen joints from those of each person, pixels, (K, F, C)."""
    seen = found.confidence2d > _SEEN
    apart: Tensor = (found.joints2d - truth).norm(dim=-1)
    return apart.where(seen, torch.nan).nanmean(-1)


def _hits(found: Detections, truth: Tensor) -> Tensor:
    torso: Tensor = (truth[..., _TORSO[0], :] - truth[..., _TORSO[1], :]).norm(dim=-1, keepdim=True)
    near: Tensor = (found.joints2d - truth).norm(dim=-1) <= _PCK * torso
    return (near & (found.confidence2d > 0))[..., _TWELVE]


def _captured(
    take: _Take,
    inputs: Inputs,
    found: Sequence[Detections],
    people: Sequence[int],
    wanted: bool,
) -> list[float]:
    """Mean joint errors, mm, in the order of what was found."""
    if not wanted:
        return [float("nan")] * len(found)
    like = torch.zeros((), dtype=torch.float64)
    cast = tuple(
        Person(take.actors[k], each.to(like)) for each, k in zip(found, people, strict=True)
    )
    done = capture(Scene(inputs.rig.cameras.to(like), cast, inputs.clip.fps))
    errors = []
    for each, k in zip(done, people, strict=True):
        joints = each.joints()
        errors.append(1000 * float((joints - take.truth[k][: len(joints)]).norm(dim=-1).nanmean()))
    return errors


if __name__ == "__main__":
    report.main(run, Experiment, "people_detected")
