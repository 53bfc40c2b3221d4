"""What silhouettes and windows each add to a body that is fitted to views (Huang et al. 2017).

Body unknown, rendered people, simulated detections. Stage one: every frame has a pose of its own,
all frames one shape, from joints, or from joints and silhouettes that are found in the images.
Stage two: windows of the motion, with that body; and with silhouettes in the windows as well.
Offsets of joints in the first frame are taken off. Expect each lower, and all at least 25 % below
joints alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import report
import torch
from contour_bodies import settled
from contours import read
from report import Report, Table
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.app.fit_views import ChosenFrames, Evidence, fit_person
from perfcap.io.body_model import load_body_model
from perfcap.io.clip import Clip
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.presets import PRESETS
from perfcap.pipeline.stage import Stage

_CHOICES = ((0, 1), (0, 3), (0, 1, 3, 4))


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_views",)
    """Of ``rendered_multi``."""


def run(config: Experiment) -> Report:
    """A row for each choice of views."""
    torch.set_num_threads(1)
    rows = [
        (name, " ".join(str(view + 1) for view in views), *_row(config.data, name, views))
        for name in config.sequences
        for views in _CHOICES
    ]
    columns = (
        "sequence", "cameras", "joints", "and silhouettes", "windows", "windows, body from "
        "silhouettes", "windows with silhouettes", "windows with contours", "lower by, %",
    )  # fmt: skip
    note = "Lower: windows with silhouettes against joints alone, frame by frame."
    return Report((Table("joints, mean / 95 %, mm", columns, tuple(rows)),), (note,))


def _row(data: Path, name: str, views: tuple[int, ...]) -> tuple[object, ...]:
    whole = read(name, data)
    seen, own = whole.select(views), whole.select(views).recording
    clip = whole.images.reader
    assert isinstance(clip, Clip)
    every = torch.arange(own.detections.frame_count)
    chosen = ChosenFrames(
        Clip([clip.sources[view] for view in views], clip.fps),
        tuple(every.tolist()),
        seen.images.cameras.frames(every),
        own.detections,
    )
    model = load_body_model()
    errors: dict[str, Tensor] = {}
    bodies: dict[str, Actor] = {}
    kinds: tuple[Evidence, ...] = ("joints", "silhouettes")
    for kind in kinds:
        fit, _ = fit_person(model, chosen, evidence=kind)
        bodies[kind] = Actor(fit.template).to(torch.zeros((), dtype=torch.float64))
        errors[kind] = settled(bodies[kind].joints(replace(fit.motion, shared={})), own.truth)
    given = own.cameras, own.detections, own.rate
    for name, body in bodies.items():
        errors[f"windows {name}"] = settled(capture(body, *given).joints(), own.truth)
    for preset in ("default", "rhodin2016"):
        found = capture(
            bodies["silhouettes"], *given, PRESETS[preset], images=seen.images,
            until=Stage.REFINE_POSE, workers=1,
        )  # fmt: skip
        errors[preset] = settled(found.joints(), own.truth)
    start, end = errors["joints"].mean(), errors["default"].mean()
    words = [f"{e.mean():.1f} / {e.quantile(0.95):.0f}" for e in errors.values()]
    return *words, 100 * float(1 - end / start)


if __name__ == "__main__":
    report.main(run, Experiment, "view_stages")
