"""Contours in raw images of cameras whose clocks differ: unknown, and found (Rhodin et al. 2016).

One camera after the other, but for the first, is late by a frame, or by half a one: then every
second frame is given, and that camera has those between. Joints against the truth at the time of
the first camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from contours import VIEWS, Seen, captured, read
from numpy.typing import NDArray
from report import Report, Table

from perfcap.io.body_model import DEFAULT_BODY, load_body_model
from perfcap.pipeline.view_errors import ViewErrors, solve_views


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_views", "dev_dance")
    """Of ``rendered_multi``."""
    views: int = 4
    """Number of views: 6, 4 or 2."""


@dataclass(frozen=True)
class _Picked:
    """Some frames of each view of a reader."""

    reader: object
    frames: list[list[int]]

    def __len__(self) -> int:
        return len(self.frames[0])

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        parts = [
            self.reader.read_view(view, frame, frame + 1)  # type: ignore[attr-defined]
            for frame in self.frames[view][start:stop]
        ]
        return np.concatenate(parts)


def run(config: Experiment) -> Report:
    """Tables of joints and of clocks."""
    torch.set_num_threads(1)
    rows, clocks = [], []
    for name in config.sequences:
        seen = read(name, config.data, "plain").select(VIEWS[config.views])
        for late in (1.0, 0.5):
            step = 1 if late == 1 else 2
            errors: dict[str, list[tuple[float, ...]]] = {}
            apart = []
            errors["right"] = [_scores(picked(seen, step, {}))]
            for view in range(1, config.views):
                own = picked(seen, step, {view: 1})
                found = clocks_of(own)
                assert found.clock is not None
                wanted = torch.zeros(config.views)
                wanted[view] = -late
                apart.append(float((found.clock - wanted).abs().max()))
                errors.setdefault("unknown", []).append(_scores(own))
                errors.setdefault("found", []).append(_scores(settled(own, found, True)))
                nearest = _scores(settled(own, found, False))
                errors.setdefault("found, nearest images", []).append(nearest)
            for kind, values in errors.items():
                rows.append((name, late, kind, *np.mean(values, 0).tolist()))
            clocks.append((name, late, max(apart)))
    columns = ("sequence", "frames late", "clocks", "joints alone: mean", "95 %",
               "contours: mean", "95 %")  # fmt: skip
    return Report(
        (
            Table(f"{config.views} views, one of them late: joints, mm", columns, tuple(rows)),
            Table("clocks, frames", ("sequence", "late", "largest error"), tuple(clocks), 2),
        ),
    )


def picked(seen: Seen, step: int, late: dict[int, int]) -> Seen:
    """Every so many frames of a recording, those of some views so many later."""
    own, views = seen.recording, len(seen.labels)
    count = (len(own.truth) - 1) // step
    frames = [[f * step + late.get(v, 0) for f in range(count)] for v in range(views)]
    index, view = torch.tensor(frames).mT, torch.arange(views)
    parts = own.detections
    given = replace(
        parts,
        joints2d=parts.joints2d[index, view],
        confidence2d=parts.confidence2d[index, view],
        trusted3d=parts.trusted3d[index, view],
    )
    first = torch.arange(count) * step
    recording = replace(own, detections=given, truth=own.truth[first], rate=own.rate / step)
    images = replace(seen.images, reader=_Picked(seen.images.reader, frames))
    return replace(seen, recording=recording, images=images)


def clocks_of(seen: Seen) -> ViewErrors:
    """As ``--sync auto`` finds them."""
    own = seen.recording
    actor = load_body_model(DEFAULT_BODY).actor(torch.zeros(0))
    like = torch.zeros((), dtype=torch.float64)
    return solve_views(actor, own.cameras.to(like), own.detections.to(like), own.rate)


def settled(seen: Seen, found: ViewErrors, between: bool) -> Seen:
    """A recording in the time of its first view, as ``--sync auto`` has it.

    Args:
        seen: it.
        found: its clocks.
        between: whether contours heed that the nearest image may be of another time.
    """
    assert found.late is not None
    own, count = seen.recording, len(seen.recording.truth)
    frames = [
        [min(max(f + round(each), 0), count - 1) for f in range(count)]
        for each in found.late.tolist()
    ]
    recording = replace(own, detections=found.of_detections(own.detections))
    lag = found.lag(range(count), [count] * len(frames)) if between else None
    reader = _Picked(seen.images.reader, frames)
    return replace(seen, recording=recording, images=replace(seen.images, reader=reader, lag=lag))


def _scores(seen: Seen) -> tuple[float, ...]:
    """Mean and 95th percentile of joints, alone and with contours, mm."""
    found: list[float] = []
    for stage in (None, "rhodin2016"):
        error = 1000 * (captured(seen, stage).joints() - seen.recording.truth).norm(dim=-1)
        found += [float(error.mean()), float(error.quantile(0.95))]
    return tuple(found)


if __name__ == "__main__":
    report.main(run, Experiment, "contour_clocks")
