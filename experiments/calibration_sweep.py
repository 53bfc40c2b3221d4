"""What wrong calibrations cost, one view and six (X17)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import report
import torch
from recordings import Recording, rendered_views
from report import Report
from sweep import Cell, Scores, Sweep, run_cells, tables
from torch import Tensor
from trials import MOTION_SCORES, motion_scores, recording_of, track

from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix


@dataclass(frozen=True)
class Experiment(Sweep):
    """What to run."""

    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt", "dev_views")
    """One view of ``rendered``, and the six of ``dev_views``."""
    turns: tuple[float, ...] = (1.0, 2.0, 5.0, 10.0, 20.0)
    """By which cameras are turned about random axes across their own, pixels in the image."""
    lenses: tuple[float, ...] = (-0.2, -0.1, -0.05, 0.05, 0.1, 0.2)
    """Share by which the focal lengths are wrong."""
    shifts: tuple[float, ...] = (0.005, 0.01, 0.02, 0.05)
    """By which the places of cameras are wrong, metres; one view alone does not notice."""


def run_cell(config: Experiment, cell: Cell) -> Scores:
    """One capture with wrong cameras."""
    recording = _recording(config, cell.sequence)
    cameras = recording.cameras
    if cell.variant != "exact":
        kind, value = cell.variant.rsplit(" ", 1)
        generator = torch.Generator().manual_seed(cell.seed)
        cameras = wrong(cameras, kind, float(value), generator)
    return motion_scores(recording, track(recording, recording.detections, None, cameras).joints())


def wrong(cameras: Camera, kind: str, value: float, generator: torch.Generator) -> Camera:
    """Cameras off by an error of one kind: ``turn px``, ``focal`` or ``shift m``."""
    like = cameras.translation
    ways = torch.randn(like.shape, generator=generator).to(like)
    if kind == "focal":
        lens = cameras.intrinsics.clone()
        lens[..., :2, :2] *= 1 + value
        return replace(cameras, intrinsics=lens)
    if kind == "shift m":
        return replace(cameras, translation=like + value * _unit(ways))
    across = _unit(ways * like.new_tensor([1.0, 1.0, 0.0]))
    angle = value / cameras.intrinsics[..., 0, 0]  # near enough for small ones
    turn = rotvec_to_matrix(angle[..., None] * across)
    return replace(
        cameras,
        rotation=turn @ cameras.rotation,
        translation=(turn @ like.unsqueeze(-1)).squeeze(-1),
    )


def _unit(vectors: Tensor) -> Tensor:
    length: Tensor = vectors.norm(dim=-1, keepdim=True)
    return vectors / length.clamp(min=math.ulp(1.0))


def _recording(config: Experiment, sequence: str) -> Recording:
    if sequence == "dev_views":
        return rendered_views(config.data, sequence)
    return recording_of(config, sequence)


def run(config: Experiment) -> Report:
    """The table."""
    variants = [
        "exact",
        *(f"turn px {v:g}" for v in config.turns),
        *(f"focal {v:g}" for v in config.lenses),
        *(f"shift m {v:g}" for v in config.shifts),
    ]
    found = run_cells("calibration_sweep", config, variants, run_cell)
    note = (
        "Detections are those of the recordings; seeds differ in the axes of turns and shifts. "
        "Every camera is turned or shifted by itself; focal lengths are all wrong by the same."
    )
    return Report(tables("mm, mm/frame²", found, MOTION_SCORES), (note,))


if __name__ == "__main__":
    report.main(run, Experiment, "calibration_sweep")
