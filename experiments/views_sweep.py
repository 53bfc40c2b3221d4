"""Motion from one to eight views: template or body unknown, triangulation beside.

Rendered people in several views with simulated detections (`dev_views`, `dev_dance`), and every
choice of views: all, some, two that look at each other. Template: the person's own; with the 3D
poses of the shipped lifter in every view beside. Auto: the body
model fitted to joints first, scored once the offset of each joint in the first frame is taken off
(where a model has its joints is not where another one has them). Exact: true projections, what rig
and priors leave. With `--silhouettes`, captures look at the images as well; that takes minutes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import report
import torch
from recordings import Recording, exact_detections, rendered_views
from report import Report, Table
from surface_recordings import clip_of
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.app.fit_views import ChosenFrames, fit_person
from perfcap.detect.detections import Detections
from perfcap.detect.lifter import OnnxLifter
from perfcap.geometry.triangulation import triangulate
from perfcap.io.actor import models_folder
from perfcap.io.body_model import load_body_model
from perfcap.io.clip import Clip
from perfcap.pipeline.bone_lengths import spread_frames
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.presets import PRESETS
from perfcap.pipeline.stage import Stage

_CHOICES = {
    "dev_views": ((0, 1, 2, 3, 4, 5), (0, 1, 3, 4), (0, 1), (0, 3), (1, 4), (2, 5)),
    "dev_dance": ((0, 1, 2, 3, 4, 5, 6), (0, 2, 4, 6), (0, 2)),
}


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_views", "dev_dance")
    """Of ``rendered_multi``."""
    silhouettes: bool = False
    """Also with the stages that look at images."""


def run(config: Experiment) -> Report:
    """A table for each sequence."""
    torch.set_num_threads(1)
    tables = []
    for name in config.sequences:
        whole = rendered_views(config.data, name)
        rows = [_row(whole, list(views), config) for views in _CHOICES[name]]
        columns: tuple[str, ...] = (
            "cameras", "triangulation", "template", "and lifter", "muvs2017", "exact",
            "template, aligned", "auto, aligned", "auto and lifter, aligned", "CPU s",
        )  # fmt: skip
        columns += ("template and images", "CPU s ") if config.silhouettes else ()
        tables.append(Table(f"{name}: joints, mean / median / 95 %, mm", columns, tuple(rows)))
    return Report(
        tuple(tables),
        ("Aligned: the offset of each joint in the first frame is taken off.",),
    )


def _row(whole: Recording, views: list[int], config: Experiment) -> tuple[object, ...]:
    cameras, seen = whole.cameras.select(views), whole.detections.select(views)
    points, _ = triangulate(cameras, cameras.to_plane(seen.joints2d), seen.confidence2d)
    start = time.process_time()
    template = capture(whole.actor, cameras, seen, whole.rate).joints()
    spent = time.process_time() - start
    paper = capture(whole.actor, cameras, seen, whole.rate, PRESETS["muvs2017"]).joints()
    true = replace(exact_detections(whole).select(views), joints3d=None)
    exact = capture(whole.actor, cameras, true, whole.rate).joints()
    fitted = fitted_actor(whole, views, seen)
    auto = capture(fitted, cameras, seen, whole.rate).joints()
    poses = OnnxLifter(models_folder() / "lifters" / "cmu")(seen, cameras, whole.rate)
    lifted, auto_lifted = (
        capture(actor, cameras, poses, whole.rate).joints() for actor in (whole.actor, fitted)
    )
    found: list[object] = [
        _words(each - whole.truth) for each in (points, template, lifted, paper, exact)
    ]
    found += [_words(_settled(each - whole.truth)) for each in (template, auto, auto_lifted)]
    more = _with_images(whole, views) if config.silhouettes else ()
    return (" ".join(str(view + 1) for view in views), *found, spent, *more)


def fitted_actor(whole: Recording, views: list[int], seen: Detections) -> Actor:
    """The body model fitted to joints of some frames, as ``--actor auto`` does."""
    frames = spread_frames(seen, 24)
    cameras = whole.cameras.select(views).frames(frames)
    chosen = ChosenFrames(clip_of(whole)[0], tuple(frames.tolist()), cameras, seen.frames(frames))
    fit, _ = fit_person(load_body_model(), chosen, evidence="joints")
    return Actor(fit.template).to(torch.zeros((), dtype=torch.float64))


def _with_images(whole: Recording, views: list[int]) -> tuple[object, ...]:
    clip, pixel_map = clip_of(whole)
    cameras = pixel_map.cameras(whole.cameras, clip.sizes).select(views)
    start = time.process_time()
    images = Images(Clip([clip.sources[view] for view in views], clip.fps), cameras)
    seen = whole.detections.select(views)
    some = whole.cameras.select(views)
    found = capture(whole.actor, some, seen, whole.rate, images=images, until=Stage.REFINE_SURFACE)
    return _words(found.joints() - whole.truth), time.process_time() - start


def _settled(error: Tensor) -> Tensor:
    """Errors (F, 16, 3) less those of the first frame."""
    return error - error[:1]


def _words(error: Tensor) -> str:
    size = 1000 * error.norm(dim=-1)
    size = size[size.isfinite()]
    return f"{size.mean():.1f} / {size.median():.1f} / {size.quantile(0.95):.0f}"


if __name__ == "__main__":
    report.main(run, Experiment, "views_sweep")
