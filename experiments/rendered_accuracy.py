"""Joint errors of one view of the rendered sequences, from raw detections to the whole capture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import report
from gross_errors import count_survivors
from recordings import Recording, exact_detections, lift, rendered
from report import Report, Table
from rig_fit import fit_rig
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.metrics import acceleration_error, joint_errors, limit_violations
from perfcap.metrics.alignment import root_aligned
from perfcap.pipeline.config import MONOPERFCAP_POSE, PoseConfig
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.stage import Stage

# joints (F, 16, 3) in the world and, where there is one, the motion behind them
Result = tuple[Tensor, Motion | None]

_FAR = 100.0  # mm: a frame whose mean joint error is larger is called lost
_COLUMNS = (
    "variant", "PA-MPJPE", "root", "absolute", "accel", "root-free", "jerk ratio",
    "outside", "worst frame", "> 100 mm",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Of ``rendered``."""
    ablations: bool = True
    """Also leave out one ingredient at a time."""


def run(config: Experiment) -> Report:
    """Score every variant on every sequence."""
    tables = []
    for name in config.sequences:
        recording = rendered(config.data, name)
        found = _variants(recording, config)
        rows = [_row(label, recording, *result) for label, result in found.items()]
        tables.append(Table(f"{name}, one view, mm and mm/frame²", _COLUMNS, tuple(rows), 2))
        gross = [
            (label, *(f"{kept} / {all_}" for all_, kept in count_survivors(recording, j).values()))
            for label, (j, _) in found.items()
            if label not in ("exact", "rig alone")
        ]
        title = f"{name}, gross errors of detections that the result follows / all"
        tables.append(Table(title, ("variant", "swaps", "outliers", "3D"), tuple(gross)))
    notes = (
        "Exact: true projections and true 3D joints as detections; what remains is the rig, the "
        "depth of one view, and what is left of the priors.",
        "No 3D term: 3D joints still start the first solve. No 2D term: a thousandth of it.",
        "Rig alone: the same rig fitted to the true 3D joints without images or prior.",
        "Acceleration errors are absolute, and root-free: without the root's, whose depth one view "
        "hardly shows. Outside: angles beyond their limits. Worst frame and > 100 mm: mean error "
        "of a frame's joints, roots aligned, and frames in which it is larger.",
    )
    return Report(tuple(tables), notes)


def _variants(recording: Recording, config: Experiment) -> dict[str, Result]:
    """Results of all variants, from the worst input to the best."""
    found: dict[str, Result] = {"detections": (lift(recording), None)}
    exact = exact_detections(recording)
    runs: Mapping[str, tuple[Detections, PoseConfig, Stage]] = {
        "each frame": (recording.detections, PoseConfig(), Stage.INITIALIZE),
        "MONOPERFCAP": (recording.detections, MONOPERFCAP_POSE, Stage.TRACK_MOTION),
        **(
            {n: (recording.detections, c, Stage.TRACK_MOTION) for n, c in ablations().items()}
            if config.ablations
            else {}
        ),
        "default": (recording.detections, PoseConfig(), Stage.TRACK_MOTION),
        "exact": (exact, PoseConfig(), Stage.TRACK_MOTION),
    }
    for name, (detections, settings, until) in runs.items():
        result = capture(
            recording.actor,
            recording.cameras,
            detections,
            recording.rate,
            CaptureConfig(settings),
            until=until,
        )
        found[name] = (result.joints(), result.motion)
    motion = fit_rig(recording.actor, recording.truth)
    found["rig alone"] = (recording.actor.joints(motion), motion)
    return found


def ablations() -> dict[str, PoseConfig]:
    """The default without one ingredient at a time."""
    base = PoseConfig()
    return {
        "no 2D kernel": replace(base, reprojection=replace(base.reprojection, scale=None)),
        "no 3D kernel": replace(base, position=replace(base.position, scale=None)),
        "no 3D gate": replace(base, position=replace(base.position, gate=float("inf"))),
        "no 3D term": replace(base, position=replace(base.position, weight=1e-9)),
        "no 2D term": replace(base, reprojection=replace(base.reprojection, weight=1e-3)),
        "sharp edge": replace(base, trajectory=replace(base.trajectory, edge=float("inf"))),
    }


def _row(
    name: str, recording: Recording, joints: Tensor, motion: Motion | None
) -> tuple[object, ...]:
    errors = joint_errors(joints, recording.truth, recording.rate)
    relative, truth = root_aligned(joints), root_aligned(recording.truth)
    frames = 1000 * (relative - truth).norm(dim=-1).mean(-1)
    outside: int | str = "-"
    if motion is not None:
        skeleton = recording.actor.skeleton
        share = limit_violations(motion.angles, skeleton.lower, skeleton.upper).share
        outside = round(float(share) / 100 * motion.angles.numel())
    means = (errors.mpjpe_similarity, errors.mpjpe_root, errors.mpjpe, errors.acceleration_error)
    return (
        name,
        *(float(value) for value in means),
        float(acceleration_error(relative, truth)),
        float(errors.jerk / errors.jerk_truth),
        outside,
        float(frames.max()),
        int((frames > _FAR).sum()),
    )


if __name__ == "__main__":
    report.main(run, Experiment, "rendered_accuracy")
