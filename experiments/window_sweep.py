"""Length, overlap and rank of the windows (MPC-8, MPC-14; X7)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import report
from report import Report
from sweep import Cell, Scores, run_cells, tables
from trials import MOTION_SCORES, MotionSweep, tracked

from perfcap.pipeline.config import MONOPERFCAP_POSE, PoseConfig
from perfcap.pipeline.presets import CaptureConfig


@dataclass(frozen=True)
class Experiment(MotionSweep):
    """What to run."""

    windows: tuple[int, ...] = (20, 30, 50, 80, 120)
    """Frames; the rank grows with them, as the prior is one of frequencies."""
    overlaps: tuple[int, ...] = (2, 5, 10, 20)
    """Frames."""
    ranks: tuple[int, ...] = (4, 8, 14, 20, 30)
    """DCT vectors of 50 frames."""
    published: bool = False
    """Start from the published weights, whose rank is 8."""


def run_cell(config: Experiment, cell: Cell) -> Scores:
    """One capture with one number changed."""
    base = MONOPERFCAP_POSE if config.published else PoseConfig()
    name, value = cell.variant.split(" ")
    if name == "rank":
        base = replace(base, trajectory=replace(base.trajectory, rank=int(value)))
    elif name == "window":
        base = replace(base, window=int(value), overlap=min(base.overlap, int(value) // 3))
    else:
        base = replace(base, overlap=int(value))
    return tracked(config, cell, CaptureConfig(base))


def run(config: Experiment) -> Report:
    """The table."""
    variants = [
        *(f"window {n}" for n in config.windows),
        *(f"overlap {n}" for n in config.overlaps),
        *(f"rank {n}" for n in config.ranks),
    ]
    found = run_cells("window_sweep", config, variants, run_cell)
    return Report(tables("mm, mm/frame²", found, MOTION_SCORES))


if __name__ == "__main__":
    report.main(run, Experiment, "window_sweep")
