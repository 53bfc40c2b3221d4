"""Numbers that a capture has for every frame, as charts to click on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.geometry.alignment import similarity_align
from perfcap.geometry.camera import Camera
from perfcap.io.result import Result
from perfcap.metrics.alignment import root_aligned
from perfcap.metrics.joints import distances
from perfcap.report.angles import NOTHING, Angles, angle_charts, trust_chart
from perfcap.report.chart import Chart, Line
from perfcap.report.sources import Sources

_SEEN = 0.2  # share of the largest confidence from which a detected joint counts
_TERMS = {
    "joints2d": "joints in the images",
    "joints3d": "joints in space",
    "trajectory": "smoothness",
    "prior": "pose prior",
    "poses": "recorded poses",
    "paths": "paths of the joints",
}
# name of the series in run.json, title of its line
_OVERLAPS = (
    (("pose", "overlap_before"), "motion of the joints"),
    (("pose", "overlap_after"), "refined motion"),
    (("surface", "overlap_after"), "refined surface"),
)


@dataclass(frozen=True)
class Measured:
    """What is known beyond the result itself.

    Attributes:
        sources: cameras and detections, as far as they were found.
        truth: true joints of the frames, (F, 16, 3) m, or None.
        angles: joint angles and trust of the frames.
    """

    sources: Sources
    truth: NDArray[np.float64] | None = None
    angles: Angles = NOTHING


@dataclass(frozen=True)
class _Frames:
    """The frames of a report, and numbers of ``run.json`` for them."""

    report: Mapping[str, Any]
    rows: slice
    total: int
    refinement: Mapping[str, Any] = field(default_factory=dict)

    def series(self, *keys: str, of: str = "refinement") -> list[float] | None:
        """A list of one number for every frame of the capture, cut to the report's."""
        value: Any = self.refinement if of == "refinement" else self.report
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else None
        if not isinstance(value, list) or len(value) != self.total:
            return None
        return [_number(each) for each in value[self.rows]]


def charts(result: Result, rows: slice, measured: Measured) -> list[Chart]:
    """All charts that a result has numbers for."""
    refinement = result.report.get("refinement")
    refined = refinement if isinstance(refinement, dict) else {}
    frames = _Frames(result.report, rows, result.frames, refined)
    found = [
        _truth(result.joints[rows], measured.truth),
        trust_chart(measured.angles),
        _overlap(frames),
        _energy(frames, result.frame_numbers),
        _reprojection(result.joints[rows], measured.sources),
        _confidence(frames),
        *_tracking(frames),
        _folds(frames),
        _acceleration(result.joints[rows], result.rate),
        *angle_charts(measured.angles),
    ]
    return [chart for chart in found if chart is not None]


def _truth(joints: NDArray[np.float64], truth: NDArray[np.float64] | None) -> Chart | None:
    if truth is None:
        return None
    about = "Mean distance of the 16 landmarks from the truth."
    return joint_distances("Joint error", joints, truth, about)


def joint_distances(
    title: str, joints: NDArray[np.float64], others: NDArray[np.float64], about: str
) -> Chart:
    """Mean distances of landmarks (F, 16, 3) m from others, as they are and aligned."""
    found, true = torch.from_numpy(joints), torch.from_numpy(others)
    pairs = {
        "absolute": (found, true),
        "roots aligned": (root_aligned(found), root_aligned(true)),
        "similarity-aligned": (similarity_align(found, true), true),
    }
    lines = tuple(Line(n, distances(a, b).mean(-1).tolist()) for n, (a, b) in pairs.items())
    return Chart(title, "mm", lines, about)


def _overlap(frames: _Frames) -> Chart | None:
    lines = tuple(_percent(frames, keys, name) for keys, name in _OVERLAPS)
    known = tuple(line for line in lines if line is not None)
    about = "Intersection over union of the model's silhouette and the mask, mean over views."
    return Chart("Overlap with the masks", "%", known, about, worst="low") if known else None


def _confidence(frames: _Frames) -> Chart | None:
    named = (
        ("mask_confidence", "trust in the contour"),
        ("mask_agreement", "overlap with a network"),
    )
    lines = (_percent(frames, (key,), name) for key, name in named)
    known = tuple(line for line in lines if line is not None)
    about = (
        "How far the outline of the masks is believed, mean over its points and the views, and how "
        "far a network of person masks agrees, least of the views."
    )
    return Chart("Trust in the masks", "%", known, about, worst="low") if known else None


def _tracking(frames: _Frames) -> Iterator[Chart]:
    """How a person was followed from frame to frame, where they were."""
    off = frames.series("tracking", "worst_limb_mm")
    if off is not None:
        about = "Root mean squared distance of the worst limb from its contours, before a search."
        yield Chart("Limbs beside their contours", "mm", (Line("worst limb", off),), about)
    searched = _percent(frames, ("tracking", "released_share"), "searched")
    if searched is not None:
        about = "Share of the pose that was searched among many, by silhouettes alone."
        yield Chart("Searched", "%", (searched,), about)


def _folds(frames: _Frames) -> Chart | None:
    line = _percent(frames, ("surface", "folded_share"), "folded triangles")
    about = "Share of the surface's triangles that the refinement turned over."
    if line is None or not np.nansum(line.values) > 0:
        return None
    return Chart("Folded triangles", "%", (line,), about)


def _percent(frames: _Frames, keys: tuple[str, ...], name: str) -> Line | None:
    values = frames.series(*keys)
    return None if values is None else Line(name, [100 * value for value in values])


def _energy(frames: _Frames, numbers: NDArray[np.int64]) -> Chart | None:
    """Terms of the pose energy: of each frame, or, of older captures, spread over windows."""
    terms = frames.report.get("energy")
    about = "Terms of the pose energy, as the window solve left them."
    if isinstance(terms, dict):
        found = {str(n): frames.series("energy", n, of="report") for n in terms}
    else:
        about += " This capture has only their mean over each window of frames."
        found = {n: v[frames.rows] for n, v in _spread(frames, numbers).items()}
    lines = tuple(Line(_TERMS.get(n, n), v) for n, v in found.items() if v is not None)
    return Chart("Energy", "", lines, about, stacked=True) if lines else None


def _spread(frames: _Frames, numbers: NDArray[np.int64]) -> dict[str, list[float]]:
    """Energy a frame by term, the mean over the windows that a frame is in."""
    sums: dict[str, NDArray[np.float64]] = {}
    count = np.zeros(frames.total)
    for start, stop, terms in windows(frames.report):
        inside = (numbers >= start) & (numbers < stop)
        count += inside
        for name, value in terms.items():
            total = sums.setdefault(name, np.zeros(frames.total))
            total += inside * value / max(1, stop - start)
    with np.errstate(invalid="ignore"):
        return {name: (total / count).tolist() for name, total in sums.items()}


def windows(report: Mapping[str, Any]) -> Iterator[tuple[int, int, dict[str, float]]]:
    """Frames and energy terms of each window that a report speaks of."""
    listed = report.get("windows")
    for window in listed if isinstance(listed, list) else []:
        span = window.get("frames") if isinstance(window, dict) else None
        terms = window.get("terms") if isinstance(window, dict) else None
        if isinstance(span, list) and len(span) == 2 and all(isinstance(x, int) for x in span):
            known = terms if isinstance(terms, dict) else {}
            yield span[0], span[1], {str(n): _number(v) for n, v in known.items()}


def _reprojection(joints: NDArray[np.float64], sources: Sources) -> Chart | None:
    cameras, seen = sources.cameras, sources.detections
    if cameras is None or seen is None:
        return None
    apart = (_pixels(cameras, joints) - seen.joints2d).norm(dim=-1)  # F C J
    counts = seen.confidence2d > _SEEN * seen.confidence2d.amax((0, 2))[:, None]
    apart = torch.where(counts, apart, torch.nan).nanmean(-1)
    lines = tuple(
        Line(name, values.tolist())
        for name, values in zip(sources.names, apart.unbind(-1), strict=True)
    )
    about = "Mean distance in the image between the model's joints and the detected ones."
    return Chart("Distance to the detections", "px", lines, about)


def _pixels(cameras: Camera, joints: NDArray[np.float64]) -> torch.Tensor:
    return cameras.project(torch.from_numpy(joints).to(cameras.intrinsics))


def _acceleration(joints: NDArray[np.float64], rate: float) -> Chart | None:
    if len(joints) < 3:
        return None
    change = rate**2 * np.linalg.norm(np.diff(joints, 2, axis=0), axis=-1)  # F-2 J
    edge = [float("nan")]
    lines = (
        Line("mean of the joints", [*edge, *change.mean(-1).tolist(), *edge]),
        Line("largest", [*edge, *change.max(-1).tolist(), *edge]),
    )
    return Chart("Acceleration", "m/s²", lines, "How suddenly joints move: jitter shows here.")


def _number(value: Any) -> float:
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if plain and abs(value) < 1e300 else float("nan")
