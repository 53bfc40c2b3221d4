"""Silhouettes by more and more knowledge (Xu et al. 2018, Fig. 4, 5 and 12).

From a box alone; from the posed model; with the motion cue (the paper's form); with what perfcap
adds; and again after the pose was refined.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
import torch
from recordings import Recording, rendered
from report import Report, Table
from surface_recordings import images_of, true_mask

from perfcap.actor.motion import Motion
from perfcap.metrics import MaskOverlap, mask_overlap
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.extract_silhouettes import extract_silhouettes
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.objective import person_height
from perfcap.pipeline.sight import Mask, Sight
from perfcap.pipeline.stage import Stage
from perfcap.segment import SequenceSettings
from perfcap.segment.baselines import box_grabcut
from perfcap.segment.settings import MODEL_ONLY, PAPER, SECOND_PASS, GrabCutSettings

_VARIANTS = {
    "model": MODEL_ONLY,
    "model + motion (the paper's)": PAPER,
    "default": GrabCutSettings(),
    "default, model believed more": SECOND_PASS,
}


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Of ``rendered``."""
    every: int = 5
    """Score every n-th frame; the box alone is slow."""


def run(config: Experiment) -> Report:
    """Score every variant on every sequence."""
    return Report(tuple(_table(rendered(config.data, n), config.every) for n in config.sequences))


def _table(recording: Recording, every: int) -> Table:
    images = images_of(recording)
    found = capture(
        recording.actor,
        recording.cameras,
        recording.detections,
        recording.rate,
        images=images,
        until=Stage.REFINE_POSE,
    )
    first = capture(recording.actor, recording.cameras, recording.detections, recording.rate)
    assert found.refinement is not None
    template = recording.actor.template
    faces = torch.as_tensor(template.faces.copy())
    sight = Sight(images.cameras, faces, template.weld()[0])
    frames = range(0, found.frames, every)

    def model(frame: int) -> Mask:
        span = slice(frame, frame + 1)
        return sight.look(recording.actor.surface(first.motion[span]), span)[0][0].mask

    def extract(motion: Motion, settings: GrabCutSettings) -> Evidence:
        chosen = SequenceSettings(frame=settings)
        height = person_height(recording.detections)
        with torch.no_grad():
            return extract_silhouettes(
                recording.actor, sight, images.reader, motion, height, chosen
            )

    def row(name: str, mask: Callable[[int], Mask]) -> tuple[object, ...]:
        scores = [mask_overlap(mask(f), true_mask(recording, f)) for f in frames]
        return (name, *(_mean(scores, key) for key in ("iou", "precision", "recall")))

    rows = [
        row("posed model itself", model),
        row("box", lambda f: box_grabcut(images.reader.read_view(0, f, f + 1)[0], model(f))),
    ]
    passes = {"first pass": first.motion, "second pass": found.refinement.pose.motion}
    for when, motion in passes.items():
        for name, settings in _VARIANTS.items():
            evidence = extract(motion, settings)
            rows.append(row(f"{when}, {name}", lambda f, e=evidence: e.masks(f)[0]))  # type: ignore[misc]
    return Table(f"{recording.name}, %", ("mask from", "IoU", "precision", "recall"), tuple(rows))


def _mean(scores: list[MaskOverlap], key: str) -> float:
    return 100 * float(np.mean([getattr(score, key) for score in scores]))


if __name__ == "__main__":
    report.main(run, Experiment, "segmentation_ablation")
