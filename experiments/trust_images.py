"""Frames of a video alone that trust names once images were looked at, and what the images add.

What of the posed body stands out of the silhouette speaks against a frame. Its limit is chosen on
films of random people, so that it hardly names a good frame there; recordings are scored with it.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
import torch
from filmed_people import films
from recordings import demo
from report import Report, Table, data_folder
from torch import Tensor
from trust_video import Judged, judged, shares
from video_alone import Experiment as Videos
from video_alone import videos

from perfcap.pipeline.trust import THRESHOLD, judge_frames
from perfcap.train.motion_library import MotionLibrary

_UNTIL = "refine_pose"


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    films: int = 16
    """Random people, who show how far good frames stand out."""
    frames: int = 48
    """Of each."""
    size: int = 480
    """Of their pictures, pixels."""
    seed: int = 21
    """Of the films."""
    recordings: bool = True
    """Whether recordings are scored, the shipped clip among them."""


def run(config: Experiment) -> Report:
    """Quantiles of good and bad frames, and shares that are named without and with images."""
    torch.set_num_threads(1)
    made = list(_films(config))
    sets = [("films", made)]
    if config.recordings:
        known = demo()
        real = [judged("demo", known.folder / "video.mp4", known.truth, _UNTIL)]
        given = Videos(config.data)
        real += [judged(v.name, v.path, v.truth, _UNTIL) for v in videos(given)]
        sets += [(each.name, [each]) for each in real]
        sets.append(("all recordings", real))
    rows = [(name, *_row(some)) for name, some in sets]
    columns = ("video", "frames", "bad", "bad named %", "good named %")
    columns += ("bad named % by images too", "good named %")
    spread = [(name, *_quantiles(some)) for name, some in sets]
    parts = [f"{kind} {share} %" for kind in ("good", "bad") for share in (50, 90, 99)]
    return Report(
        (
            Table("frames named by trust", columns, tuple(rows), 0),
            Table("percent of the squared height beyond masks", ("video", *parts), tuple(spread)),
        )
    )


def _films(config: Experiment) -> list[Judged]:
    library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    with tempfile.TemporaryDirectory() as folder:
        size = config.frames, config.size, config.seed
        made = films(Path(folder), library, config.films, *size) if config.films else ()
        return [judged(each.name, each.path, each.truth, _UNTIL) for each in made]


def _row(some: list[Judged]) -> tuple[float, ...]:
    bad = torch.cat([each.bad for each in some])
    joints = torch.cat([judge_frames(each.evidence).value for each in some]) < THRESHOLD
    images = torch.cat([_with_images(each) for each in some])
    return (*shares(bad, joints), *shares(bad, images)[2:])


def _with_images(each: Judged) -> Tensor:
    return judge_frames(each.evidence, each.beyond).value < THRESHOLD


def _quantiles(some: list[Judged]) -> tuple[float, ...]:
    bad = torch.cat([each.bad for each in some]).numpy()
    out = np.concatenate([each.beyond.numpy() for each in some if each.beyond is not None])
    parts = [
        np.quantile(out[chosen], (0.5, 0.9, 0.99)) if chosen.any() else np.full(3, np.nan)
        for chosen in (~bad, bad)
    ]
    return tuple(np.concatenate(parts).tolist())


if __name__ == "__main__":
    report.main(run, Experiment, "trust_images")
