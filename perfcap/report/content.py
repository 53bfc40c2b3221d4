"""What the viewer is given of a result: plain values, and arrays and files as text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from perfcap.io.result import Result
from perfcap.pipeline.surroundings import Surroundings
from perfcap.report.curves import Measured, charts
from perfcap.report.marks import Mark, marks
from perfcap.report.model import Model, scene_arrays
from perfcap.report.opening import opening_frame
from perfcap.report.packing import encode, pack
from perfcap.report.views import Views


@dataclass(frozen=True)
class Content:
    """One result, for the viewer.

    Attributes:
        data: plain values.
        blobs: base64 by name.
        marks: stretches that stand out, as ``data`` has them.
    """

    data: dict[str, Any]
    blobs: dict[str, str]
    marks: list[Mark]


def content(
    result: Result,
    rows: slice,
    model: Model,
    views: Views,
    measured: Measured,
    prefix: str = "",
) -> Content:
    """Put everything about some frames of a result together.

    Args:
        result: the capture.
        rows: its shown frames.
        model: what is drawn in 3D.
        views: videos and what is drawn over them.
        measured: what is known beyond the result.
        prefix: of the names of blobs, where a page shows several results.
    """
    numbers = result.frame_numbers[rows]
    first = int(numbers[0])
    found = marks(result.report, first, int(numbers[-1]) + 1)
    arrays = pack({**model.arrays, **views.arrays})
    blobs = {f"{prefix}model": arrays.text}
    blobs |= {f"{prefix}{name}": encode(data) for name, data in views.videos.items()}
    around = Surroundings.around(torch.from_numpy(result.joints), result.shown, shown=rows)
    trust = measured.angles.trust
    data: dict[str, Any] = {
        "name": result.folder.resolve().name,
        "first": first,
        "frames": len(numbers),
        "opening": opening_frame(len(numbers), trust, views.arrays, views.plain, found, first),
        "rate": result.rate,
        "scene": scene_arrays(around),
        "arrays": arrays.entries,
        "views": views.plain,
        "charts": [chart.plain() for chart in charts(result, rows, measured)],
        "marks": [mark.plain() for mark in found],
    }
    if model.surface is not None and model.box is not None:
        surface = pack({"coded": model.surface})
        blobs[f"{prefix}surface"] = surface.text
        data["surface"] = {
            "arrays": surface.entries,
            "origin": model.box.origin.tolist(),
            "step": model.box.step,
        }
    if model.texture is not None:
        blobs[f"{prefix}texture"] = encode(model.texture[0])
        data["texture"] = {"type": model.texture[1]}
    return Content(data, blobs, found)
