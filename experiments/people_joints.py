"""Several people captured from shuffled detections, against exact truth."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import report
import torch
from people_takes import Crowd, people_of, shuffled
from recordings import Recording
from report import RESULTS, Report, Table
from torch import Tensor

from perfcap.app.match_people import match_actors
from perfcap.detect.association import associate
from perfcap.geometry.triangulation import triangulate
from perfcap.io.calibration import match_image
from perfcap.io.clip import Clip
from perfcap.metrics import joint_errors, skin_gap
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.keep_apart import ApartConfig
from perfcap.pipeline.overlay import save_people_overlay
from perfcap.pipeline.people import Person, Scene
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import CaptureConfig
from perfcap.render.projected_mesh import vertex_normals

DEEP = 0.005  # m: skins in each other by less are as they may be
_FEWER = {6: ((0, 2, 4, 5), (0, 3)), 5: ((0, 1, 3), (0, 3))}


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_duo", "dev_trio", "dev_twins")
    """Of ``rendered_multi``."""
    fewer: bool = True
    """Also from four or three, and from two views."""
    overlays: bool = False
    """Write videos of all views beside the numbers."""


def run(config: Experiment) -> Report:
    """All tables."""
    rows, given, touching = [], [], []
    for name in config.sequences:
        people = people_of(config.data, name)
        crowd = shuffled(people)
        views = tuple(range(crowd.cameras.views))
        sets = (views, *(_FEWER[len(views)] if config.fewer else ()))
        for chosen in sets:
            found, spent = _captured(crowd.select(chosen), people)
            rows += _rows(found, people, len(chosen), spent)
            touching.append((name, len(chosen), *_touching(crowd.select(chosen), people, found)))
            if config.overlays and chosen == views:
                _overlay(found, people)
        given += [_given(each, views) for each in people]
    columns = ("take", "person", "views", "mean", "median", "95 %", "root", "PA", "jerk ratio", "s")
    titles = ("take", "person", "capture with identity given", "triangulation, identity given")
    return Report(
        (
            Table("joints from shuffled detections, mm", columns, tuple(rows)),
            Table(
                "the same with identity given as in the file, all views, mm", titles, tuple(given)
            ),
            Table(
                "skins more than 5 mm in each other: frames, and the deepest, mm",
                (
                    "take",
                    "views",
                    "not kept apart",
                    "deepest",
                    "kept apart",
                    "deepest",
                    "moved, mm",
                ),
                tuple(touching),
            ),
        ),
        (
            "Actors are given, in no order: nobody says how many people there are, who is who in "
            "any frame and view, nor which actor is whose. s: CPU of the whole take, everybody.",
        ),
    )


def _captured(
    crowd: Crowd, people: Sequence[Recording], config: CaptureConfig | None = None
) -> tuple[tuple[Performance, ...], float]:
    """Everybody, in the order of ``people``, whose actors are found by bone lengths."""
    start = time.process_time()
    found = associate(crowd.cameras, crowd.candidates, crowd.rate)
    actors = [person.actor for person in people]
    tracks = match_actors(actors, found, [person.name for person in people]).tracks
    cast = tuple(Person(a, found.people[k]) for a, k in zip(actors, tracks, strict=True))
    results = capture(Scene(crowd.cameras, cast, crowd.rate), config=config)
    return results, time.process_time() - start


def _rows(
    found: Sequence[Performance], people: Sequence[Recording], views: int, spent: float
) -> list[tuple[object, ...]]:
    rows: list[tuple[object, ...]] = []
    for number, (each, person) in enumerate(zip(found, people, strict=True), 1):
        joints = each.joints()
        apart = 1000 * (joints - person.truth).norm(dim=-1).numpy()
        e = joint_errors(joints, person.truth, person.rate)
        numbers = (apart.mean(), np.median(apart), np.quantile(apart, 0.95))
        values = (*map(float, numbers), float(e.mpjpe_root), float(e.mpjpe_similarity))
        ratio = round(float(e.jerk / e.jerk_truth), 2)
        rows.append((person.name, number, views, *values, str(ratio), spent))
    return rows


def _touching(
    crowd: Crowd, people: Sequence[Recording], apart: Sequence[Performance]
) -> tuple[float, ...]:
    """Frames with skins in each other, and how deep, without and with keeping people apart."""
    free, _ = _captured(crowd, people, CaptureConfig(apart=ApartConfig(enabled=False)))
    row: list[float] = []
    for found in (free, apart):
        deep = np.array([_deepest(found, frame) for frame in range(found[0].frames)])
        row += [int((deep > DEEP).sum()), 1000 * float(deep.max())]
    far = [(a.joints() - b.joints()).norm(dim=-1).max() for a, b in zip(free, apart, strict=True)]
    return (*row, 1000 * float(max(far)))


def _deepest(found: Sequence[Performance], frame: int) -> float:
    """How deep anybody is in anybody else, m."""
    skins = []
    for each in found:
        vertices = each.actor.surface(each.motion[frame : frame + 1])[0].double()
        faces = torch.as_tensor(each.actor.template.faces.copy())
        skins.append((vertices.numpy(), vertex_normals(vertices, faces).numpy()))
    return max(0.0, *(-skin_gap(one, other) for one, other in combinations(skins, 2)))


def _given(person: Recording, views: Sequence[int]) -> tuple[object, ...]:
    """The person alone, from the detections that the file says are theirs."""
    cameras, seen = person.cameras.select(list(views)), person.detections.select(list(views))
    found = capture(person.actor, cameras, seen, person.rate)
    points, _ = triangulate(cameras, cameras.to_plane(seen.joints2d), seen.confidence2d)
    number = person.sequence.name if person.sequence is not None else ""
    return (
        person.name,
        number.rpartition("/")[2],
        *(_mean(j, person) for j in (found.joints(), points)),
    )


def _mean(joints: Tensor, person: Recording) -> float:
    return 1000 * float((joints - person.truth).norm(dim=-1).nanmean())


def _overlay(found: Sequence[Performance], people: Sequence[Recording]) -> None:
    folder = people[0].folder
    clip = Clip.open([folder / "views" / f"{name}.mp4" for name in people[0].rig.names])
    RESULTS.mkdir(exist_ok=True)
    pixel_map = match_image(people[0].rig, clip.sizes)
    save_people_overlay(RESULTS / f"people_{people[0].name}.mp4", found, clip, pixel_map)


if __name__ == "__main__":
    report.main(run, Experiment, "people_joints")
