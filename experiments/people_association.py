"""Who is who: shuffled detections of several people, put together over views and time."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
from numpy.typing import NDArray
from people_takes import Crowd, people_of, pose2sim, shuffled, spoiled
from report import Report, Table
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from perfcap.detect.association import Association, associate

_VIEWS = {6: ((0, 1, 2, 3, 4, 5), (0, 2, 4, 5), (0, 3)), 5: ((0, 1, 2, 3, 4), (0, 1, 3), (0, 3))}


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_duo", "dev_trio", "dev_twins")
    """Of ``rendered_multi``."""
    seeds: int = 12
    """Of planted mistakes."""


def run(config: Experiment) -> Report:
    """All tables."""
    crowds = [shuffled(people_of(config.data, name)) for name in config.sequences]
    rows = [
        _row(each.select(views))
        for each in crowds
        for views in _VIEWS[each.cameras.views]
    ]  # fmt: skip
    columns = ("take", "views", "found people", "right, %", "missing, %", "wrong, %", "ms a frame")
    planted = tuple(_planted(each, config.seeds) for each in crowds)
    return Report(
        (
            Table("shuffled detections, rendered", columns, tuple(rows), 2),
            Table("OpenPose of a real recording, by person", columns, _real(config.data), 2),
            Table(
                f"mistakes planted in 30 % of frames and views, {config.seeds} seeds",
                ("take", "right of the untouched, worst seed, %", "median", "wrong, worst seed, %",
                 "people exchanged, seeds"),
                planted,
                2,
            ),
        ),
        (
            "Right: of the detections that show a person, those the person was given. Nobody says "
            "how many people there are.",
            "Planted: a limb of two people exchanged, one person listed twice and another not at "
            "all, one missed; in every frame two views are left as they were.",
        ),
    )  # fmt: skip


def _row(crowd: Crowd) -> tuple[object, ...]:
    found, spent = _timed(crowd)
    people = crowd.owner.max() + 1
    who, pairs = matched(crowd, found.slots)
    right = sum(int((who[k] == person).sum()) for k, person in pairs)
    given = sum(int((who[k] != -2).sum()) for k, _ in pairs)
    total = int((crowd.owner >= 0).sum())
    numbers = (100 * right / total, 100 * (total - given) / total, 100 * (given - right) / total)
    views = crowd.cameras.views
    return (crowd.name, views, f"{len(found.people)} of {people}", *numbers, spent)


def _real(data: Path) -> tuple[tuple[object, ...], ...]:
    """The phantom of the answer key and the man, each; other people of the video are no mistake."""
    crowd = pose2sim(data)
    found, spent = _timed(crowd)
    who, pairs = matched(crowd, found.slots)
    rows = []
    for k, person in pairs:
        total = int((crowd.owner == person).sum())
        right = int((who[k] == person).sum())
        mistaken = int(((who[k] >= 0) & (who[k] != person)).sum())
        name = f"{crowd.name}, {('phantom', 'man')[person]}"
        numbers = (100 * right / total, 100 * (total - right - mistaken) / total)
        views, count = crowd.cameras.views, f"{len(found.people)}"
        rows.append((name, views, count, *numbers, 100 * mistaken / total, spent))
    return tuple(rows)


def _planted(crowd: Crowd, seeds: int) -> tuple[object, ...]:
    right, wrong, exchanged = [], [], 0
    for seed in range(seeds):
        take, kept = spoiled(crowd, seed)
        found, _ = _timed(take)
        who, pairs = matched(take, found.slots)
        own = [((take.owner == person) & kept).any(0) for _, person in pairs]
        good = sum(
            int(((who[k] == p) & mine).sum()) for (k, p), mine in zip(pairs, own, strict=True)
        )
        right.append(100 * good / sum(int(each.sum()) for each in own))
        bad = sum(int(((who[k] >= 0) & (who[k] != person)).sum()) for k, person in pairs)
        wrong.append(100 * bad / (take.owner >= 0).sum())
        # in a frame where most views of somebody show another, identity is lost
        exchanged += any(_lost(who[k], person) for k, person in pairs)
    return (crowd.name, min(right), float(np.median(right)), max(wrong), exchanged)


def _lost(who: NDArray[np.int64], person: int) -> bool:
    given = (who >= 0).sum(-1)
    return bool((((who == person).sum(-1) < 0.5 * given) & (given > 0)).any())


def matched(crowd: Crowd, slots: Tensor) -> tuple[NDArray[np.int64], list[tuple[int, int]]]:
    """Whom slots (K, F, C) show, -2 where there is none, and pairs of found and true people."""
    at = slots.numpy()
    shown = np.take_along_axis(crowd.owner, np.maximum(at, 0), 0)
    who = np.where(at >= 0, shown, -2)
    count = int(crowd.owner.max()) + 1
    common = np.array([[(each == person).sum() for person in range(count)] for each in who])
    rows, columns = linear_sum_assignment(-common)
    return who, list(zip(rows.tolist(), columns.tolist(), strict=True))


def _timed(crowd: Crowd) -> tuple[Association, float]:
    """The association, and milliseconds of CPU a frame."""
    start = time.process_time()
    found = associate(crowd.cameras, crowd.candidates, crowd.rate)
    return found, 1000 * (time.process_time() - start) / crowd.candidates.frame_count


if __name__ == "__main__":
    report.main(run, Experiment, "people_association")
