"""What a worse template costs: smoothed, of the wrong size, or of somebody else (LIU-E8; X6)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import report
import trimesh
from recordings import Recording
from report import Report
from sweep import Cell, Scores, Sweep, run_cells, tables
from trials import motion_scores, recording_of, simulated, surface_scores, track, whole

from perfcap.actor.actor import Actor
from perfcap.actor.template import Template
from perfcap.io.actor import load_actor
from perfcap.pipeline.presets import CaptureConfig

_SMOOTHER = 0.5  # of a Laplacian step


@dataclass(frozen=True)
class Experiment(Sweep):
    """What to run."""

    frames: int = 30
    """Of each sequence, from its first."""
    every: int = 5
    """Score every n-th frame's surface."""
    smooth: tuple[int, ...] = (5, 20, 80)
    """Steps of smoothing; each takes detail off the mesh, and width off its limbs."""
    sizes: tuple[float, ...] = (0.9, 0.95, 1.05, 1.1)
    """Times the true height."""
    other: str = "sam"
    """Somebody else's template."""


def smoothed(template: Template, steps: int) -> Template:
    """Without detail; texture seams stay closed."""
    of, first = template.weld()
    mesh = trimesh.Trimesh(template.vertices[first], of[template.faces], process=False)
    trimesh.smoothing.filter_laplacian(mesh, _SMOOTHER, steps, volume_constraint=False)
    return replace(template, vertices=np.ascontiguousarray(mesh.vertices[of]))


def resized(template: Template, factor: float) -> Template:
    """The same person taller or smaller."""
    rest = template.bone_rest.copy()
    rest[:, :3, 3] *= factor
    points = {name: (bone, factor * place) for name, (bone, place) in template.landmarks.items()}
    return replace(
        template, vertices=factor * template.vertices, bone_rest=rest, landmarks=points, space=None
    )


def run_cell(config: Experiment, cell: Cell) -> Scores:
    """One capture with another template."""
    recording = recording_of(config, cell.sequence, config.frames)
    own, (kind, _, value) = recording.actor.template, cell.variant.partition(" ")
    detections = simulated(recording, cell.seed)
    if kind == "somebody":  # whose vertices are others: the motion alone has a truth
        other = replace(recording, actor=load_actor(config.other))
        scores = motion_scores(recording, track(other, detections).joints())
        return {"PA-MPJPE": scores["PA-MPJPE"], "IoU %": float("nan"), "surface mm": float("nan")}
    changed = {"own": own}.get(kind) or (
        smoothed(own, int(value)) if kind == "smoothed" else resized(own, float(value))
    )
    wrong: Recording = replace(recording, actor=Actor(changed))
    found = whole(wrong, detections, CaptureConfig())
    joints = motion_scores(recording, found.joints())
    return {"PA-MPJPE": joints["PA-MPJPE"]} | dict(surface_scores(wrong, found, config.every))


def run(config: Experiment) -> Report:
    """The table."""
    variants = [
        "own",
        *(f"smoothed {n}" for n in config.smooth),
        *(f"height {f:g}" for f in config.sizes),
        "somebody else",
    ]
    found = run_cells("template_quality", config, variants, run_cell)
    return Report(tables("one view", found, digits=2))


if __name__ == "__main__":
    report.main(run, Experiment, "template_quality")
