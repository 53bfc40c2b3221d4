"""What spoiled silhouettes do to the surface, with and without pruning (Xu et al. 2018, Fig. 12).

Silhouettes of the second extraction are spoiled: blobs that touch 5, 15 and 30 % of the contour,
an arm or a lower leg cut off. The surface is refined on them with the pipeline's own trust in
contour points, with blind trust in all of them, and blindly without pruning. The mask is good where
a vertex projects further from what was spoiled than the largest blob's radius.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
from recordings import rendered
from report import Report, Table
from spoiled_masks import LARGEST, Blobs, Fault, MissingLimb
from spoiled_take import TRUSTS, Take
from surface_recordings import Mask

_LIMBS = {"no arm": ("r_shoulder", "r_elbow", "r_wrist"), "no lower leg": ("l_knee", "l_ankle")}
_COLUMNS = (
    "masks", "trust", "spoiled %", "good", "worst frame", "all", "beyond pose", "worst frame",
    "where spoiled",
)  # fmt: skip
_NOTES = (
    "Surface errors after the mean offset is removed, mm. Good: growth where the mask is good, "
    "over the surface refined with the same trust in masks that were not spoiled, in the mean and "
    "in the worst frame; all: the same of the whole surface.",
    "Beyond pose: by how much the whole error exceeds that of the skinned surface, in the mean "
    "and in the worst frame, and in the mean where the mask is not good.",
)


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Of ``rendered``."""
    frames: int = 40
    """Of the clip, from its first."""
    every: int = 5
    """Score every n-th frame."""
    shares: tuple[float, ...] = (0.05, 0.15, 0.3)
    """Of the contour that blobs touch."""
    seed: int = 0
    """Of the blobs."""


def run(config: Experiment) -> Report:
    """Spoil every sequence in every way."""
    tables = []
    for name in config.sequences:
        take = Take.read(rendered(config.data, name), config.frames)
        rows = _rows(take, config)
        tables.append(Table(f"{name}, {take.found.frames} frames", _COLUMNS, rows, 2))
    return Report(tuple(tables), _NOTES)


def _rows(take: Take, config: Experiment) -> tuple[tuple[object, ...], ...]:
    """One for every fault and kind of trust."""
    whole: dict[int, Mask | None] = dict.fromkeys(range(0, take.found.frames, config.every))
    references = {trust: take.refined(take.clean, trust) for trust in TRUSTS}
    clean = {trust: take.errors(surface, whole) for trust, surface in references.items()}
    pose = take.errors(take.skinned, whole)
    rows = []
    for fault in _faults(take, config):
        spoiled = take.spoiled(fault)
        good = {frame: take.good(spoiled, frame) for frame in whole}
        bad = {frame: ~part for frame, part in good.items()}
        before = take.errors(take.skinned, bad)
        for trust, reference in references.items():
            surface = take.refined(spoiled, trust)
            growth = take.errors(surface, good) - take.errors(reference, good)
            found = take.errors(surface, whole)
            numbers = (
                100 * take.share(spoiled), np.nanmean(growth), np.nanmax(growth),
                np.mean(found - clean[trust]), np.mean(found - pose), np.max(found - pose),
                np.nanmean(take.errors(surface, bad) - before),
            )  # fmt: skip
            rows.append((fault.name, trust, *np.array(numbers).tolist()))
    return tuple(rows)


def _faults(take: Take, config: Experiment) -> list[Fault]:
    faults: list[Fault] = [Blobs(s, take.height, config.seed) for s in config.shares]
    reach = LARGEST * take.height
    return faults + [MissingLimb(n, of, take.found.actor, reach) for n, of in _LIMBS.items()]


if __name__ == "__main__":
    report.main(run, Experiment, "mask_corruption")
