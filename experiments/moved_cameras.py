"""Cameras that do not stand as stated: put right by joints, and by silhouettes after them.

Every camera of a rendered clip is turned and shifted at random, and the person captured with what
is then a wrong calibration: as it is, with cameras that joints moved, and with those that
silhouettes moved after them, as ``--refine-cameras`` does where images are looked at. Beside them
the same with the right calibration, which both should leave alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from contours import VIEWS, Seen, read
from real_silhouettes import by_joints
from report import Report, Table
from torch import Tensor

from perfcap.app.networks import find_segmenter
from perfcap.detect import OnnxSegmenter
from perfcap.geometry.alignment import procrustes
from perfcap.geometry.camera import Camera
from perfcap.metrics import mask_overlap, surface_error
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.surface_config import RefineCamerasConfig

_COLUMNS = (
    "sequence",
    "calibration",
    "cameras",
    "IoU %",
    "worst view %",
    "surface mm",
    "joints mm",
)


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_views", "dev_dance")
    """Of ``rendered_multi``, one person each."""
    views: int = 4
    """Number of views: 6, 4 or 2."""
    seeds: tuple[int, ...] = (1,)
    """Of the errors of a calibration."""
    turn: float = 0.4
    """Degrees about each axis, standard deviation."""
    shift: float = 10.0
    """Millimetres along each axis, standard deviation."""
    network: str = "blazepose"
    """Of person masks."""
    every: int = 3
    """Score every n-th frame."""


def run(config: Experiment) -> Report:
    """Score every way with every calibration."""
    rows = []
    for name in config.sequences:
        seen = read(name, config.data, "plain").select(VIEWS[config.views])
        for seed in (None, *config.seeds):
            about = "right" if seed is None else f"wrong, seed {seed}"
            stated = seen.recording.cameras.nudged(_errors(config.views, seed, config))
            for cameras in ("as stated", "by joints", "by silhouettes"):
                found = _captured(seen, stated, cameras, config.network)
                rows.append((name, about, cameras, *_scores(seen, found, config.every)))
                print(*rows[-1], sep="\t", flush=True)
    notes = (
        f"Wrong: turned by {config.turn:g} degrees and shifted by {config.shift:g} mm about and "
        "along each axis, standard deviations. Surfaces and joints are brought onto the truth by "
        "one rigid motion of the whole clip: where the world stands, no view shows.",
    )
    title = f"{config.views} views, overlap with true masks by the cameras of the capture"
    return Report((Table(title, _COLUMNS, tuple(rows), 2),), notes)


def _captured(seen: Seen, stated: Camera, cameras: str, network: str) -> Performance:
    own = seen.recording
    own = replace(own, rig=replace(own.rig, cameras=stated))
    now = stated if cameras == "as stated" else by_joints(own)
    segmenter = OnnxSegmenter(find_segmenter(network))
    return capture(
        *(own.actor, now, own.detections, own.rate),
        CaptureConfig(refine_cameras=RefineCamerasConfig(cameras == "by silhouettes")),
        images=replace(seen.images, cameras=now, segmenter=segmenter, edges=None),
    )


def _errors(views: int, seed: int | None, config: Experiment) -> Tensor:
    """Turns and shifts of the cameras in their own axes, (C, 6), radians and metres."""
    if seed is None:
        return torch.zeros(views, 6, dtype=torch.float64)
    random = torch.Generator().manual_seed(seed)
    spread = torch.tensor([np.radians(config.turn)] * 3 + [config.shift / 1000] * 3)
    return spread * torch.randn(views, 6, generator=random, dtype=torch.float64)


def _scores(seen: Seen, found: Performance, every: int) -> tuple[float, ...]:
    """Overlap, mean of the views and worst, %; errors of surface and joints, mm."""
    surface, sequence, truth = found.surface, seen.recording.sequence, seen.recording.truth
    assert surface is not None and sequence is not None and sequence.surface is not None
    template, frames = found.actor.template, range(0, found.frames, every)
    cameras = replace(found.cameras, size=seen.images.cameras.size)
    sight = Sight(cameras, torch.as_tensor(template.faces.copy()), template.weld()[0])
    joints, known = found.joints(), truth.isfinite().all(-1)
    world = procrustes(joints[known], truth[known], scale=False)
    apart = (world.apply(joints[known]) - truth[known]).norm(dim=-1)
    real, errors, overlaps = sequence.surface(), [], []
    for frame in frames:
        span, random = slice(frame, frame + 1), np.random.default_rng(0)
        drawn = next(sight.outlines(surface[span], span))
        masks = [each[frame] == seen.person for each in seen.labels]
        pairs = zip(drawn, masks, strict=True)
        overlaps.append([mask_overlap(outline.mask, mask).iou for outline, mask in pairs])
        vertices = world.apply(surface[span][0].double()).numpy()[real.order]
        error = surface_error(vertices, real.vertices[frame], real.faces, random)
        errors.append(error.surface)
    views = 100 * np.mean(overlaps, 0)
    return (
        float(views.mean()),
        float(views.min()),
        float(np.mean(errors)),
        1000 * float(apart.mean()),
    )


if __name__ == "__main__":
    report.main(run, Experiment, "moved_cameras")
