"""How captures stand up to worse detectors: jitter, swaps, outliers, depth flips (X15)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import report
from detection_noise import Noise
from report import Report
from sweep import Cell, Scores, run_cells, tables
from trials import MOTION_SCORES, MotionSweep, motion_scores, recording_of, simulated, track

_KINDS = ("jitter", "swaps", "outliers", "flips", "wrong")


@dataclass(frozen=True)
class Experiment(MotionSweep):
    """What to run."""

    levels: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0, 4.0)
    """Times what the simulated detector of the rendered sequences errs."""
    kinds: tuple[str, ...] = (*_KINDS, "all")
    """Of errors; the others stay as they are."""


def noise_of(variant: str) -> Noise:
    """The detector of a variant, such as ``swaps x 2``."""
    kind, level = variant.split(" x ")
    return replace(Noise(), **{name: float(level) for name in _KINDS if kind in (name, "all")})


def run_cell(config: Experiment, cell: Cell) -> Scores:
    """One capture from one detector."""
    recording = recording_of(config, cell.sequence, config.frames)
    detections = simulated(recording, cell.seed, noise_of(cell.variant))
    return motion_scores(recording, track(recording, detections).joints())


def run(config: Experiment) -> Report:
    """The table."""
    variants = [f"{kind} x {level:g}" for kind in config.kinds for level in config.levels]
    found: Mapping[Cell, Scores] = run_cells("noise_sweep", config, variants, run_cell)
    notes = (
        "Times 1: the detector that the rendered sequences document. Jitter: 2D and 3D, slow and "
        "fast. Swaps: left and right in 2D. Outliers: 2D joints anywhere in the body's box. Flips: "
        "limbs in 3D to the other side in depth. Wrong: whole 3D poses of other frames, turned.",
    )
    return Report(tables("mm, mm/frame²", found, MOTION_SCORES), notes)


if __name__ == "__main__":
    report.main(run, Experiment, "noise_sweep")
