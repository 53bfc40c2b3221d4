"""Several views: a real man against triangulation, a view left out, each view alone; a jump."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import report
from recordings import Recording, balancing, rendered_views
from report import RESULTS, Report, Table
from torch import Tensor

from perfcap.geometry.alignment import similarity_align
from perfcap.geometry.triangulation import triangulate
from perfcap.io.calibration import match_image, read_pixel_map
from perfcap.io.clip import Clip
from perfcap.metrics import joint_errors
from perfcap.metrics.alignment import root_aligned
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.overlay import save_overlay
from perfcap.pipeline.performance import Performance

_CONFIDENT = 0.3  # detections that an unseen view is scored on


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    actor: str = "sam"
    """The generic actor that stands for the real man; his bone lengths are solved."""
    sequence: str = "dev_views"
    """Of ``rendered_multi``."""
    overlays: bool = False
    """Write videos of the real man, of all views and of each alone, beside the numbers."""


def run(config: Experiment) -> Report:
    """All tables."""
    real, jump = balancing(config.data, config.actor), rendered_views(config.data, config.sequence)
    views = list(range(real.cameras.views))
    together = _capture(real, views, config)
    others = [[v for v in views if v != view] for view in views]
    tables = (
        _accuracy(real, together),
        _unseen(real, others, [_capture(real, some, config) for some in others]),
        _alone(real, {real.rig.names[v]: _capture(real, [v], config) for v in views}),
        _rendered(jump),
    )
    notes = (
        "The reference is triangulated from the same detections, good to some centimetres; a "
        "constant offset a joint is where a detector and the rig place it.",
        "One view alone has no 3D detections and a template of the wrong size: depth is a guess.",
    )
    return Report(tables, notes)


def _capture(real: Recording, views: list[int], config: Experiment) -> Performance:
    """The real man from some views; bone lengths are solved where views show them."""
    found = capture(
        real.actor,
        real.cameras.select(views),
        real.detections.select(views),
        real.rate,
        solve_bones=len(views) > 1,
    )
    if config.overlays and len(views) in (1, real.cameras.views):
        _overlay(real, views, found)
    return found


def _accuracy(real: Recording, found: Performance) -> Table:
    error = found.joints() - real.truth
    rows = ((len(found.cameras.intrinsics), _mean(error), _mean(error - error.nanmean(0))),)
    columns = ("views", "distance", "distance but for a constant offset a joint")
    return Table("balancing: distance of joints to the reference, mm", columns, rows)


def _mean(error: Tensor) -> float:
    """Mean over joints of the mean distance over frames, mm."""
    return 1000 * float(error.norm(dim=-1).nanmean(0).nanmean())


def _unseen(real: Recording, seen: Sequence[list[int]], found: Sequence[Performance]) -> Table:
    rows = []
    for some, performance in zip(seen, found, strict=True):
        left_out = next(v for v in range(real.cameras.views) if v not in some)
        cameras, detections = real.cameras.select(some), real.detections.select(some)
        plane = cameras.to_plane(detections.joints2d)
        points, _ = triangulate(cameras, plane, detections.confidence2d)
        fitted, crossed = (_median_px(real, left_out, p) for p in (performance.joints(), points))
        rows.append((real.rig.names[left_out], *fitted, *crossed))
    columns = ("unseen view", "capture, median", "90 %", "triangulation, median", "90 %")
    return Table(
        "balancing: detections of a view predicted by the others, px", columns, tuple(rows)
    )


def _median_px(real: Recording, view: int, points: Tensor) -> tuple[float, float]:
    """Median and 90th percentile of the distance to confident detections of a view, pixels."""
    pixels = real.cameras.select([view]).project(points)[:, 0]
    apart = (pixels - real.detections.joints2d[:, view]).norm(dim=-1)
    counted = apart[(real.detections.confidence2d[:, view] > _CONFIDENT) & apart.isfinite()]
    return float(counted.median()), float(counted.quantile(0.9))


def _alone(real: Recording, found: dict[str, Performance]) -> Table:
    valid = real.truth.isfinite().all(-1).all(-1)
    truth = real.truth[valid]
    rows = []
    for name, performance in found.items():
        joints = performance.joints()[valid]
        aligned = similarity_align(joints, truth)
        rooted = root_aligned(joints) - root_aligned(truth)
        rows.append(
            (name, int(valid.sum()), _mean(aligned - truth), _mean(rooted), _mean(joints - truth))
        )
    columns = ("view", "frames", "similarity-aligned", "roots aligned", "absolute")
    return Table("balancing: one view alone, mm", columns, tuple(rows))


def _rendered(jump: Recording) -> Table:
    found = capture(jump.actor, jump.cameras, jump.detections, jump.rate)
    plane = jump.cameras.to_plane(jump.detections.joints2d)
    points, _ = triangulate(jump.cameras, plane, jump.detections.confidence2d)
    rows = []
    for name, joints in (("triangulation", points), ("capture", found.joints())):
        e = joint_errors(joints, jump.truth, jump.rate)
        values = (e.mpjpe, e.mpjpe_root, e.mpjpe_similarity, e.acceleration_error)
        rows.append((name, *(float(v) for v in values), float(e.jerk / e.jerk_truth)))
    columns = ("method", "absolute", "root", "PA-MPJPE", "accel", "jerk ratio")
    return Table(f"{jump.name}, {jump.cameras.views} views, mm", columns, tuple(rows), 2)


def _overlay(real: Recording, views: list[int], found: Performance) -> None:
    videos = [sorted((real.folder / "videos").glob("*.mp4"))[v] for v in views]
    clip = Clip.open(videos)
    pixel_map = match_image(
        real.rig.select(views), clip.sizes, read_pixel_map(real.folder / "video_to_native.json")
    )
    RESULTS.mkdir(exist_ok=True)
    name = "all" if len(views) > 1 else videos[0].stem
    save_overlay(RESULTS / f"balancing_{name}.mp4", found, clip, pixel_map)


if __name__ == "__main__":
    report.main(run, Experiment, "multi_view")
