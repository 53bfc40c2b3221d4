"""What each stage contributes to pose and surface (Xu et al. 2018, Fig. 7, 10 and 17).

Errors should fall at every stage: each frame on its own, windows, motion refined by silhouettes,
surface refined by silhouettes. Writes the curve of the surface error over time as a picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import report
from curves import Curve, draw_curves
from recordings import Recording, rendered
from report import Report, Table
from surface_recordings import SurfaceTruth, images_of, silhouette_overlap, true_mask

from perfcap.app.networks import NO_SEGMENTER, find_segmenter
from perfcap.detect import OnnxSegmenter
from perfcap.metrics import joint_errors, mask_overlap
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import PRESETS
from perfcap.pipeline.stage import Stage

_COLUMNS = (
    "stage", "PA-MPJPE", "accel", "jerk ratio", "IoU %", "masks %", "surface mm", "vertex mm",
    "garment mm", "side IoU %",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Of ``rendered``."""
    stages: tuple[str, ...] = tuple(stage.name.lower() for stage in Stage)
    """Each captured anew up to there; every one if not given."""
    preset: str = "default"
    """Settings of the capture."""
    every: int = 2
    """Score every n-th frame's surface."""
    network: str = "blazepose"
    """Of person masks: a shipped one by name, or a manifest; none to go without."""


def run(config: Experiment) -> Report:
    """Score every stage on every sequence."""
    tables = []
    for name in config.sequences:
        recording = rendered(config.data, name)
        truth = SurfaceTruth.read(recording)
        rows, curves = [], []
        for stage in (Stage[each.upper()] for each in config.stages):
            found = _capture(recording, stage, config)
            row, errors = _score(stage.name.lower(), recording, truth, found, config.every)
            rows.append(row)
            curves.append(Curve(stage.name.lower().replace("_", " "), errors))
        tables.append(Table(f"{name}, one view", _COLUMNS, tuple(rows), 2))
        picture = draw_curves(curves, f"{name}: surface error after translation, mm", config.every)
        report.RESULTS.mkdir(exist_ok=True)
        cv2.imwrite(str(report.RESULTS / f"stage_ablation_{name}.png"), picture)
    notes = (
        "Surface and vertex errors are after the mean offset is removed; the side camera is never "
        "an input. Garment: surface error of loose cloth alone.",
    )
    return Report(tuple(tables), notes)


def _capture(recording: Recording, stage: Stage, config: Experiment) -> Performance:
    asked = config.network != NO_SEGMENTER and stage.needs_images
    segmenter = OnnxSegmenter(find_segmenter(config.network)) if asked else None
    return capture(
        recording.actor,
        recording.cameras,
        recording.detections,
        recording.rate,
        PRESETS[config.preset],
        images=replace(images_of(recording), segmenter=segmenter),
        until=stage,
    )


def _masks(recording: Recording, found: Performance, frames: range) -> float | str:
    """Mean overlap of the masks with the truth, where there are any."""
    if found.refinement is None:
        return "-"
    masks = {f: found.refinement.evidence.masks(f)[0] for f in frames}
    scores = [mask_overlap(mask, true_mask(recording, f)).iou for f, mask in masks.items()]
    return 100 * float(np.mean(scores))


def _score(
    name: str, recording: Recording, truth: SurfaceTruth, found: Performance, every: int
) -> tuple[tuple[object, ...], list[float]]:
    joints = joint_errors(found.joints(), recording.truth, recording.rate)
    images, surface = images_of(recording), found.shown
    frames = range(0, found.frames, every)
    vertices = {f: surface[f : f + 1][0].double().numpy() for f in frames}
    errors = [truth.error(vertices[f], f) for f in frames]
    garment = [truth.garment_error(vertices[f], f) for f in frames]
    loose = [error.surface for error in garment if error is not None]
    row = (
        name,
        float(joints.mpjpe_similarity),
        float(joints.acceleration_error),
        float(joints.jerk / joints.jerk_truth),
        100 * float(np.mean([silhouette_overlap(recording, images, surface, f) for f in frames])),
        _masks(recording, found, frames),
        float(np.mean([error.surface for error in errors])),
        float(np.mean([error.vertex for error in errors])),
        float(np.mean(loose)) if loose else "-",
        100 * float(np.mean([truth.side_overlap(vertices[f], f) for f in frames])),
    )
    return row, [error.surface for error in errors]


if __name__ == "__main__":
    report.main(run, Experiment, "stage_ablation")
