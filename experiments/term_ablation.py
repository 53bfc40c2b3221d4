"""What each term and each safeguard of the motion is worth: left out one at a time (MPC-E2)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import report
import torch
from report import Report
from sweep import Cell, run_cells, tables
from trials import MOTION_SCORES, MotionSweep, motion_scores, recording_of, simulated, track

from perfcap.actor.actor import Actor
from perfcap.pipeline.config import MONOPERFCAP_POSE, PoseConfig
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.stage import Stage

_NEGLIGIBLE = 1e-9  # weight


@dataclass(frozen=True)
class Experiment(MotionSweep):
    """What to run."""


def _settings() -> Mapping[str, Callable[[PoseConfig], PoseConfig]]:
    def part(name: str, **changes: Any) -> Callable[[PoseConfig], PoseConfig]:
        return lambda base: replace(base, **{name: replace(getattr(base, name), **changes)})

    return {
        "default": lambda base: base,
        "no E_2d": part("reprojection", weight=_NEGLIGIBLE),
        "no E_3d": part("position", weight=_NEGLIGIBLE),
        "no E_d": part("trajectory", weight=_NEGLIGIBLE),
        "no 2D kernel": part("reprojection", scale=None),
        "no 3D kernel": part("position", scale=None),
        "no 3D gate": part("position", gate=math.inf),
        "windows overlap by 2": lambda base: replace(base, overlap=2),
        "no pose prior": part("prior", weight=_NEGLIGIBLE),
        "published weights": lambda base: MONOPERFCAP_POSE,
    }


VARIANTS = (*_settings(), "no joint limits", "no temporal solve")


def run_cell(config: Experiment, cell: Cell) -> Mapping[str, float]:
    """One capture without something."""
    recording = recording_of(config, cell.sequence, config.frames)
    if cell.variant == "no joint limits":
        recording = replace(recording, actor=_unlimited(recording.actor))
    change = _settings().get(cell.variant)
    pose = change(PoseConfig()) if change else PoseConfig()
    until = Stage.INITIALIZE if cell.variant == "no temporal solve" else Stage.TRACK_MOTION
    detections = simulated(recording, cell.seed)
    found = track(recording, detections, CaptureConfig(pose), until=until)
    return motion_scores(recording, found.joints())


def _unlimited(actor: Actor) -> Actor:
    """The same person with joints that turn anywhere."""
    free = Actor(actor.template)
    with torch.no_grad():
        free.skeleton.lower.fill_(-math.pi)
        free.skeleton.upper.fill_(math.pi)
    return free


def run(config: Experiment) -> Report:
    """The table."""
    found = run_cells("term_ablation", config, VARIANTS, run_cell)
    return Report(tables("mm, mm/frame²", found, MOTION_SCORES), (
        "Detections are simulated anew for every seed; ± is the deviation over seeds. No temporal "
        "solve: each frame on its own, as it starts the windows.",
    ))  # fmt: skip


if __name__ == "__main__":
    report.main(run, Experiment, "term_ablation")
