"""Views that are some frames late, in short clips: how often that is named, and said of right ones.

Parts of the recordings with two and three views, as they are and with the last view so many frames
late. What is named of right ones is a false alarm. ``examine_agreement`` is what captures and
doctor ask. Its thresholds were chosen with the same clips in view.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import report
import torch
from recordings import Recording, balancing, rendered_views
from report import Report, Table

from perfcap.detect.detections import Detections
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Finding, Severity, examine_agreement

_SEVERAL = (("dev_views", 1), ("dev_dance", 1), ("dev_duo", 2), ("dev_trio", 3), ("dev_twins", 2))
_WORDS = "synchronise the videos"


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    lengths: tuple[int, ...] = (12, 16, 24, 36, 50)
    """Frames of the parts."""
    lags: tuple[int, ...] = (3, 5, 10)
    """Frames by which a view is late."""
    parts: int = 12
    """Of each recording, length and number of views, drawn at random."""
    seed: int = 0
    """Of the parts."""


def run(config: Experiment) -> Report:
    """A row for each length and number of views."""
    torch.set_num_threads(1)
    clips = list(_clips(config.data))
    rows = []
    for views in (2, 3):
        for length in config.lengths:
            rng = np.random.default_rng([config.seed, views, length])
            said: dict[int, list[list[Finding]]] = {lag: [] for lag in (0, *config.lags)}
            for clip in clips:
                for some, first in _drawn(clip, views, length, max(config.lags), config.parts, rng):
                    rig = clip.rig.select(some)
                    for lag, found in said.items():
                        seen = _part(clip.detections, some, first, length, lag)
                        found.append(_wrong(rig, seen))
            rows.append((views, length, len(said[0]), *_shares(said)))
    lags = (f"{lag} late: named, %" for lag in config.lags)
    alarms = ("late, refused, %", "late, warned, %", "anything refused, %")
    columns = ("views", "frames", "parts", *(f"right: {each}" for each in alarms), *lags)
    return Report((Table("views that are late", columns, tuple(rows), 1),))


def _clips(data: Path) -> Iterator[Recording]:
    for name, people in _SEVERAL:
        yield from (rendered_views(data, name, person) for person in range(1, people + 1))
    yield balancing(data)


def _drawn(
    clip: Recording, views: int, length: int, lag: int, parts: int, rng: np.random.Generator
) -> Iterator[tuple[list[int], int]]:
    """Views, and the first frame of a part that has so many before it."""
    every = list(combinations(range(clip.cameras.views), views))
    last = clip.detections.frame_count - length
    for _ in range(parts if last >= lag else 0):
        some = rng.permutation(every[int(rng.integers(len(every)))]).tolist()
        yield some, int(rng.integers(lag, last + 1))


def _part(seen: Detections, views: list[int], first: int, length: int, lag: int) -> Detections:
    """Some views of a part, the last one as it was so many frames before."""
    some = seen.select(views).without_poses()
    here, before = (some.frames(slice(at, at + length)) for at in (first, first - lag))
    late = torch.zeros(1, len(views), dtype=torch.bool)
    late[:, -1] = True
    return before.where(late, here)


def _wrong(rig: CameraRig, seen: Detections) -> list[Finding]:
    return [each for each in examine_agreement(rig, seen) if each.severity is not Severity.INFO]


def _shares(said: dict[int, list[list[Finding]]]) -> Iterator[float]:
    """Percent of the parts of which something is said; of late ones, that they are."""
    for severity in (Severity.ERROR, Severity.WARNING):
        yield _percent([[each for each in one if _late(each, severity)] for one in said[0]])
    refused = [[each for each in one if each.severity is Severity.ERROR] for one in said[0]]
    yield _percent(refused)
    for lag, found in said.items():
        if lag:
            yield _percent([[each for each in one if _WORDS in each.remedy] for one in found])


def _late(found: Finding, severity: Severity) -> bool:
    return found.severity is severity and _WORDS in found.remedy


def _percent(said: list[list[Finding]]) -> float:
    return 100 * sum(map(bool, said)) / len(said)


if __name__ == "__main__":
    report.main(run, Experiment, "late_views")
