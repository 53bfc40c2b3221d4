"""Real video, one view at a time: OpenPose's 2D joints, a lifter, and the window solve."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import report
import torch
from recordings import Recording, balancing
from report import Report, Table
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.lifter import OnnxLifter
from perfcap.io.actor import models_folder
from perfcap.metrics import joint_errors
from perfcap.pipeline.jobs import capture


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    lifter: Path = models_folder() / "lifters" / "cmu"
    """The lifter's folder."""
    actor: str = "sam"
    """The generic actor that stands for the real man; one view does not tell his bone lengths."""


def run(config: Experiment) -> Report:
    """PA-MPJPE of each view."""
    real, lifter = balancing(config.data, config.actor), OnnxLifter(config.lifter)
    rows = [_row(real, lifter, view) for view in range(real.cameras.views)]
    means = [sum(float(row[k]) for row in rows) / len(rows) for k in range(1, len(rows[0]))]
    columns = (
        *("view", "each frame alone", "lifter", "window solve", "solve without lifter"),
        *("below each frame, %", "below the lifter, %", "acceleration, lifter", "solve"),
    )
    table = Table(
        "balancing, one view: PA-MPJPE, mm (accelerations: mm/frame²)",
        columns,
        (*rows, ("mean", *means)),
    )
    notes = (
        "The reference is triangulated from the same detections in four views, good to some "
        "centimetres; the lifter has seen neither this man nor real detections.",
    )
    return Report((table,), notes)


def _row(real: Recording, lifter: OnnxLifter, view: int) -> tuple[str | float, ...]:
    camera, found = real.cameras.select([view]), real.detections.select([view])
    poses, _ = lifter.lift(found, camera, real.rate)
    alone = torch.cat([lifter.lift(_frame(found, f), camera, real.rate)[0] for f in range(60)])
    lifted = lifter(found, camera, real.rate)
    solved = capture(real.actor, camera, lifted, real.rate)
    plain = capture(real.actor, camera, found, real.rate)
    errors = [
        _errors(real, points)
        for points in (alone[:, 0], poses[:, 0], solved.joints(), plain.joints())
    ]
    values = [error for error, _ in errors]
    gains = [100 * (1 - values[2] / before) for before in values[:2]]
    return (real.rig.names[view], *values, *gains, errors[1][1], errors[2][1])


def _frame(detections: Detections, frame: int) -> Detections:
    return detections.frames(slice(frame, frame + 1))


def _errors(real: Recording, joints: Tensor) -> tuple[float, float]:
    found = joint_errors(joints, real.truth[: len(joints)], real.rate)
    return float(found.mpjpe_similarity), float(found.acceleration_error)


if __name__ == "__main__":
    report.main(run, Experiment, "lifter_real")
