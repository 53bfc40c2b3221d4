"""Silhouettes of a real man in four views against masks drawn by hand.

The generic actor with solved bone lengths does not wear what he wears: what the surface adds to
the pose is his clothes. Labels repeat to an IoU of about 0.98 (``tests/labels``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from recordings import Recording, balancing
from report import Report, Table
from surface_recordings import clip_of

from perfcap.app.networks import NO_SEGMENTER, find_segmenter
from perfcap.detect.segmenter import OnnxSegmenter
from perfcap.geometry.camera import Camera
from perfcap.io.actor import load_actor
from perfcap.io.mask_files import fill, read_labels
from perfcap.metrics import mask_overlap
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.sight import Mask, Sight
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.surface import SkinnedSurface, SurfaceFrames
from perfcap.pipeline.surface_config import RefineCamerasConfig
from perfcap.pipeline.view_errors import solve_views

_LABELS = Path(__file__).parents[1] / "tests" / "labels" / "pose2sim_balancing"


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    alone: tuple[int, ...] = (2,)
    """Views that are also captured on their own, with the bone lengths of all four."""
    actor: Path | None = None
    """The man's own body, as ``perfcap actor fit`` writes it; the generic actor if not given."""
    network: str = NO_SEGMENTER
    """Of person masks, as one more cue; none if not given."""
    refine_cameras: bool = False
    """Let joints, and then silhouettes, put the four cameras where they stand."""


@dataclass(frozen=True)
class _Some:
    """Some views of a reader."""

    images: Images
    views: list[int]

    def __len__(self) -> int:
        return len(self.images.reader)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        return self.images.reader.read_view(self.views[view], start, stop)


def run(config: Experiment) -> Report:
    """Score every stage in every labelled frame."""
    real = balancing(config.data)
    if config.actor is not None:
        real = replace(real, actor=load_actor(config.actor))
    if config.refine_cameras:
        real = replace(real, rig=replace(real.rig, cameras=by_joints(real)))
    clip, pixel_map = clip_of(real)
    segmenter = None
    if config.network != NO_SEGMENTER:
        segmenter = OnnxSegmenter(find_segmenter(config.network))
    cameras = pixel_map.cameras(real.cameras, clip.sizes)
    images = Images(clip, cameras, segmenter=segmenter)
    labels = labels_of(clip.sizes)
    views = list(range(real.cameras.views))
    solve_bones = config.actor is None
    settings = CaptureConfig(refine_cameras=RefineCamerasConfig(config.refine_cameras))
    together = _capture(real, images, views, real, solve_bones, settings)
    rows = _rows("four views", together, images.cameras, views, labels)
    for view in config.alone:
        name = real.rig.names[view]
        found = _capture(real, images, [view], together)
        rows += _rows(f"{name} alone", found, images.cameras.select([view]), [view], labels)
    columns = ("captured from", "what", *real.rig.names)
    return Report((Table("IoU with masks drawn by hand, %", columns, tuple(rows)),))


def labels_of(sizes: Sequence[tuple[int, int]]) -> list[dict[int, Mask]]:
    """Masks drawn by hand in every view of that (H, W), by frame."""
    return [
        {f: fill(lines, size) for f, lines in read_labels(path, size).items()}
        for path, size in zip(sorted(_LABELS.glob("*.json")), sizes, strict=True)
    ]


def by_joints(recording: Recording) -> Camera:
    """Cameras where joints have them, as ``perfcap capture --refine-cameras`` begins."""
    given = recording.actor, recording.cameras, recording.detections, recording.rate
    return solve_views(*given, sync=False, refine=True).of_cameras(recording.cameras)


def _capture(
    real: Recording,
    images: Images,
    views: list[int],
    source: Recording | Performance,
    solve_bones: bool = False,
    settings: CaptureConfig | None = None,
) -> Performance:
    reader, cameras = _Some(images, views), images.cameras.select(views)
    some = Images(reader, cameras, segmenter=images.segmenter)
    return capture(
        source.actor,
        real.cameras.select(views),
        real.detections.select(views),
        real.rate,
        settings,
        images=some,
        solve_bones=solve_bones,
    )


def _rows(
    name: str,
    found: Performance,
    cameras: Camera,
    views: list[int],
    labels: list[dict[int, Mask]],
) -> list[tuple[object, ...]]:
    assert found.refinement is not None and found.surface is not None
    if found.refinement.views is not None:
        cameras = found.refinement.views.of_cameras(cameras)
    before = capture(
        found.actor, found.cameras, found.detections, found.rate, until=Stage.TRACK_MOTION
    )
    surfaces: Mapping[str, SurfaceFrames] = {
        "pose": SkinnedSurface(found.actor, before.motion),
        "refined pose": SkinnedSurface(found.actor, found.motion),
        "refined surface": found.surface,
    }
    template = found.actor.template
    sight = Sight(cameras, torch.as_tensor(template.faces.copy()), template.weld()[0])
    silhouettes = found.refinement.evidence.silhouettes

    def row(what: str, score: Mapping[int, float]) -> tuple[object, ...]:
        return (name, what, *(score.get(view, "-") for view in range(len(labels))))

    def mean(mask_of: object, position: int, view: int) -> float:
        known = labels[view]
        return 100 * float(
            np.mean([mask_overlap(mask_of(f, position), m).iou for f, m in known.items()])  # type: ignore[operator]
        )

    rows = []
    for what, surface in surfaces.items():

        def drawn(frame: int, position: int, surface: SurfaceFrames = surface) -> Mask:
            span = slice(frame, frame + 1)
            return sight.look(surface[span], span, (position,))[0][0].mask

        rows.append(row(what, {v: mean(drawn, i, v) for i, v in enumerate(views)}))
    masks = {v: mean(silhouettes.mask, i, v) for i, v in enumerate(views)}
    return [*rows, row("mask", masks)]


if __name__ == "__main__":
    report.main(run, Experiment, "real_silhouettes")
