"""Two views from opposite sides, and what the 3D poses of a lifter add to their joints.

Recorded motion of people from whom the shipped lifter has not learned, at its own speed and half
again as fast, on the person's own bones, seen by a simulated detector. 3D poses count as
``PositionConfig.lasting`` says, or more, or less. And for how many frames errors stay alike, which
is where that number is from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import report
import torch
from fast_motion import Experiment as Motion
from fast_motion import Take, takes
from report import Report, Table
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.lifter import OnnxLifter
from perfcap.detect.retarget import mid_hip
from perfcap.io.actor import models_folder
from perfcap.pipeline.config import PositionConfig
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.presets import CaptureConfig

_CLIPS = (
    "06_01", "06_02", "06_05", "06_07", "06_11",
    "07_01", "07_02", "07_03", "07_06", "07_08", "07_10",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    views: int = 2
    """Number of views, around the person."""
    clips: int = len(_CLIPS)
    """Of the library, at most."""
    frames: int = 60
    """Of a clip, at most."""
    lasting: tuple[float, ...] = (1.0, 3.0, 12.0, 36.0)
    """How much longer errors of 3D poses are taken to last than those of 2D joints."""
    seed: int = 0
    """Of cameras and noise."""


def run(config: Experiment) -> Report:
    """A row for every take, medians and means below."""
    torch.set_num_threads(1)
    lifter = OnnxLifter(models_folder() / "lifters" / "cmu")
    motion = Motion(config.data, frames=config.frames, seed=config.seed)
    chosen = list(takes(motion, config.views, _CLIPS[: config.clips]))
    rows = [_row(take, lifter, config) for take in chosen]
    errors = torch.tensor([row[1:] for row in rows])
    summary = [
        ("median", *errors.median(0).values.tolist()),
        ("mean", *errors.mean(0).tolist()),
        ("nine in ten below", *errors.quantile(0.9, dim=0).tolist()),
    ]
    columns = ("take", "2D joints", *(f"3D poses, lasting {each:g}" for each in config.lasting))
    table = Table("mean joint error, mm", columns, (*rows, *summary))
    return Report((table, _lasting(chosen, lifter)), ())


def _row(take: Take, lifter: OnnxLifter, config: Experiment) -> tuple[str | float, ...]:
    plain = replace(take.detections, joints3d=None)
    lifted = lifter(plain, take.cameras, 30.0)
    found = [_error(take, plain, 1.0), *(_error(take, lifted, each) for each in config.lasting)]
    return (take.name, *found)


def _error(take: Take, seen: Detections, lasting: float) -> float:
    settings = CaptureConfig()
    pose = replace(settings.pose, position=replace(PositionConfig(), lasting=lasting))
    found = capture(take.actor, take.cameras, seen, 30.0, replace(settings, pose=pose)).joints()
    return 1000 * float((found - take.truth[: len(found)]).norm(dim=-1).mean())


def _lasting(chosen: list[Take], lifter: OnnxLifter) -> Table:
    """For how many frames errors stay alike, of each take in each view."""
    found: dict[str, list[float]] = {"3D poses": [], "2D joints": []}
    for take in chosen:
        plain = replace(take.detections, joints3d=None)
        poses, _ = lifter.lift(plain, take.cameras, 30.0)
        local = take.cameras.to_camera(take.truth)
        for view in range(take.cameras.views):
            error = _about_hips(poses[:, view]) - _about_hips(local[:, view])
            found["3D poses"].append(_alike(error))
            shown = take.cameras.project_camera(local)[:, view]
            found["2D joints"].append(_alike(plain.joints2d[:, view] - shown))
    quantiles = torch.tensor([0.5, 0.1, 0.9], dtype=torch.float64)
    rows = [(k, *torch.tensor(v).double().quantile(quantiles).tolist()) for k, v in found.items()]
    columns = ("errors of", "frames, median", "10 %", "90 %")
    return Table("integrated autocorrelation, frames", columns, tuple(rows))


def _about_hips(joints: Tensor) -> Tensor:
    return joints - mid_hip(joints).unsqueeze(-2)


def _alike(error: Tensor) -> float:
    """Integrated autocorrelation of errors (F, 16, D), frames, up to where they are unlike."""
    products = [(error[: len(error) - k] * error[k:]).sum() for k in range(len(error) // 2)]
    share = torch.stack([p / (len(error) - k) for k, p in enumerate(products)])
    share = share / share[0]
    unlike = torch.nonzero(share < 0)
    end = int(unlike[0]) if len(unlike) else len(share)
    return 1 + 2 * float(share[1:end].sum())


if __name__ == "__main__":
    report.main(run, Experiment, "two_views")
