"""Motion and surface found in one solve, beside stage after stage.

One view of the rendered sequences. Both ways start from the same motion and get the same automatic
masks; truth is for scoring only.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from recordings import Recording, rendered
from report import Report, Table
from surface_recordings import SurfaceTruth, images_of, true_mask
from torch import Tensor
from torch.nn.functional import avg_pool2d

from perfcap.geometry.camera import Camera
from perfcap.metrics import joint_errors, mask_overlap
from perfcap.pipeline import (
    JointConfig,
    Performance,
    SkinnedSurface,
    SurfaceFrames,
    capture,
    refine_jointly,
    resized,
)
from perfcap.pipeline.sight import Sight

_COLUMNS = (
    "",
    "overlap %",
    "surface mm",
    "vertices mm",
    "PA-MPJPE mm",
    "MPJPE mm",
    "CPU s a frame",
)
_STAGES = ("refine_pose", "refine_surface")


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt", "dev_coat")
    """Of ``rendered``."""
    frames: int = 50
    """Of each."""
    nodes: int = JointConfig().nodes
    """Of the joint solve's graph."""


def run(config: Experiment) -> Report:
    """Score every way on every sequence."""
    torch.set_num_threads(1)
    tables = [_compared(config, name) for name in config.sequences]
    notes = (
        "Stage after stage: the CPU time of pose and surface refinement. The masks are the second "
        "ones, for both; of these times neither counts them.",
        "Surface: both ways, means of all vertices aligned. Every second frame is scored.",
    )
    return Report(tuple(tables), notes)


class _Scene:
    """A sequence, captured without images and with them."""

    def __init__(self, config: Experiment, name: str) -> None:
        self.recording: Recording = rendered(config.data, name)
        self.span = slice(0, config.frames)
        images = images_of(self.recording).frames(self.span)
        parts = (
            self.recording.actor,
            self.recording.cameras.frames(self.span),
            self.recording.detections.frames(self.span),
            self.recording.rate,
        )
        self.start: Performance = capture(*parts)
        self.whole = capture(*parts, images=images, workers=1)
        self.cameras: Camera = images.cameras.to(self.start.motion.angles)
        self.truth = SurfaceTruth.read(self.recording)
        template = self.recording.actor.template
        faces = torch.as_tensor(template.faces.copy())
        self.sight = Sight(self.cameras, faces, template.weld()[0])

    def masks(self) -> Tensor:
        """The second automatic ones at half their size, soft, (F, 1, H, W)."""
        assert self.whole.refinement is not None
        evidence = self.whole.refinement.evidence
        frames = range(self.span.stop)
        hard = torch.from_numpy(np.stack([np.stack(evidence.masks(f)) for f in frames]))
        return avg_pool2d(hard.double(), 2)

    def score(self, surface: SurfaceFrames, joints: Tensor) -> tuple[float, ...]:
        """Overlap %, surface and vertex error mm, PA-MPJPE and MPJPE mm."""
        overlaps, errors = [], []
        for frame in range(0, self.span.stop, 2):
            here = surface[frame : frame + 1]
            drawn = self.sight.look(here, slice(frame, frame + 1))[0][0].mask
            overlaps.append(mask_overlap(drawn, true_mask(self.recording, frame)).iou)
            error = self.truth.error(here[0].double().numpy(), frame)
            errors.append((error.surface, error.vertex))
        truth = self.recording.truth[self.span]
        pose = joint_errors(joints, truth, self.recording.rate)
        means = (*np.mean(errors, 0), pose.mpjpe_similarity, pose.mpjpe)
        return 100 * float(np.mean(overlaps)), *(float(value) for value in means)


def _compared(config: Experiment, name: str) -> Table:
    scene = _Scene(config, name)
    start, whole = scene.start, scene.whole
    staged = sum(s.cpu for s in whole.stages if s.name in _STAGES) / config.frames
    masks, settings = scene.masks(), JointConfig(nodes=config.nodes)
    views = resized(replace(scene.cameras), (masks.shape[-2], masks.shape[-1]))
    began = time.process_time()
    found = refine_jointly(start, masks, views, config=settings)
    spent = (time.process_time() - began) / config.frames
    skinned = SkinnedSurface(start.actor, start.motion)
    rows = (
        ("motion alone", *scene.score(skinned, start.joints()), 0.0),
        ("stage after stage", *scene.score(whole.shown, whole.joints()), staged),
        ("in one solve", *scene.score(found, start.actor.joints(found.motion)), spent),
    )
    return Table(f"{name}, {config.frames} frames", _COLUMNS, rows, 2)


if __name__ == "__main__":
    report.main(run, Experiment, "joint_refinement")
