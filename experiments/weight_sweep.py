"""Does it matter what weights are? Each one times 0.25 to 4 (Xu et al. 2018, Sec. 6; X18)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import report
from report import Report
from sweep import Cell, Scores, Sweep, run_cells, tables
from trials import (
    MOTION_SCORES,
    motion_scores,
    recording_of,
    simulated,
    surface_scores,
    track,
    whole,
)

from perfcap.pipeline.presets import PRESETS, CaptureConfig

_MOTION = {
    "E_2d": "pose.reprojection.weight",
    "E_3d": "pose.position.weight",
    "E_d": "pose.trajectory.weight",
    "lambda_t": "pose.trajectory.translation",
    "lambda_R": "pose.trajectory.rotation",
    "lambda_Theta": "pose.trajectory.angles",
    "pose prior": "pose.prior.weight",
}
_SURFACE = {
    "pose contour": "refine_pose.contour.weight",
    "w_stab": "refine_pose.stabilization",
    "surface contour": "refine_surface.contour.weight",
    "w_arap": "refine_surface.rigidity",
    "tether": "refine_surface.tether",
}


@dataclass(frozen=True)
class Experiment(Sweep):
    """What to run."""

    preset: str = "default"
    """Settings whose weights are changed; the published ones are ``monoperfcap``."""
    factors: tuple[float, ...] = (0.25, 0.5, 2.0, 4.0)
    """Times the preset's."""
    part: str = "motion"
    """``motion`` without images, or ``surface`` with."""
    frames: int = 0
    """Of each sequence; all when 0."""
    every: int = 5
    """Score every n-th frame's surface."""


def scaled(settings: Any, path: str, factor: float) -> Any:
    """Settings with one number, or tuple of them, times a factor."""
    name, _, rest = path.partition(".")
    value = getattr(settings, name)
    if rest:
        value = scaled(value, rest, factor)
    else:
        value = tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
    return replace(settings, **{name: value})


def run_cell(config: Experiment, cell: Cell) -> Scores:
    """One capture."""
    settings: CaptureConfig = PRESETS[config.preset]
    if cell.variant != "as it is":
        name, factor = cell.variant.split(" x ")
        settings = scaled(settings, (_MOTION | _SURFACE)[name], float(factor))
    recording = recording_of(config, cell.sequence, config.frames)
    detections = simulated(recording, cell.seed)
    if config.part == "motion":
        return motion_scores(recording, track(recording, detections, settings).joints())
    found = whole(recording, detections, settings)
    scores = {"PA-MPJPE": motion_scores(recording, found.joints())["PA-MPJPE"]}
    return scores | dict(surface_scores(recording, found, config.every))


def run(config: Experiment) -> Report:
    """The table."""
    names = _MOTION if config.part == "motion" else _SURFACE
    variants = [f"{name} x {factor:g}" for name in names for factor in config.factors]
    found = run_cells("weight_sweep", config, ["as it is", *variants], run_cell)
    chosen = MOTION_SCORES if config.part == "motion" else ()
    note = "A weight of zero in the preset stays zero."
    return Report(tables(f"{config.preset}, {config.part}", found, chosen, 2), (note,))


if __name__ == "__main__":
    report.main(run, Experiment, "weight_sweep")
