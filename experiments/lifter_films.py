"""A lifter on what the default networks find of rendered people who move as people held out."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import report
import torch
from filmed_tracks import Experiment as Films
from filmed_tracks import write_tracks
from report import Report, Table
from torch import Tensor

from perfcap.detect.lifter import OnnxLifter
from perfcap.geometry.alignment import similarity_align
from perfcap.io.actor import models_folder
from perfcap.train.lifting_data import root_relative
from perfcap.train.seen_tracks import SeenTracks


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings, with mocap_cmu_library in it."""
    tracks: Path | None = None
    """File of tracks that filmed_tracks.py wrote of these people, to use again."""
    lifter: Path = models_folder() / "lifters" / "cmu"
    """The lifter's folder."""
    people: tuple[str, ...] = ("06", "07")
    """Whose motion."""
    count: int = 32
    """Videos."""
    seed: int = 100
    """Of these."""


def run(config: Experiment) -> Report:
    """PA-MPJPE of tracks as found, and of the true ones."""
    torch.set_num_threads(1)
    lifter = OnnxLifter(config.lifter)
    with tempfile.TemporaryDirectory() as folder:
        path = config.tracks or Path(folder) / "tracks.npz"
        if config.tracks is None:
            films = Films(data=config.data, out=path, people=config.people)
            write_tracks(replace(films, count=config.count, seed=config.seed), all_of_them=True)
        tracks = SeenTracks.read(path)
    exact = tracks.joints[..., :2] / tracks.joints[..., 2:]
    rows = (
        ("as found", *_errors(lifter, tracks, tracks.plane, tracks.confidence)),
        ("true joints", *_errors(lifter, tracks, exact, torch.ones_like(tracks.confidence))),
    )
    columns = ("tracks", "mean", "median", "worst", "MPJPE, median", "expected, median")
    return Report((Table("videos, PA-MPJPE mm", columns, rows),))


def _errors(
    lifter: OnnxLifter, tracks: SeenTracks, plane: Tensor, confidence: Tensor
) -> tuple[float, ...]:
    """Of the videos' errors mean, median and largest, and what was expected of unaligned ones."""
    joints, spread = lifter.lift_tracks(plane, confidence)
    truth = root_relative(tracks.joints)
    off = (similarity_align(joints, truth) - truth).norm(dim=-1).mean((1, 2))
    whole = (joints - truth).norm(dim=-1)
    found = off.mean(), off.median(), off.max(), whole.median(), spread.median()
    return tuple(1e3 * float(value) for value in found)


if __name__ == "__main__":
    report.main(run, Experiment, "lifter_films")
