"""What the viewer is given of a result: plain values, and arrays and files as text."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.io.result import Result
from perfcap.pipeline.surroundings import Surroundings, upright
from perfcap.report.curves import Measured, charts
from perfcap.report.marks import Mark, marks
from perfcap.report.model import Model, scene_arrays
from perfcap.report.views import Views

# --- The frame that a page opens with: one that is trusted and shows the person well --------------

_EQUAL = 0.02  # of trust times visible share: frames that are as good as the best one


def opening_frame(
    frames: int,
    trust: NDArray[np.float64] | None,
    arrays: dict[str, NDArray[Any]],
    views: Sequence[dict[str, Any]],
    marks: Sequence[Mark],
    first: int,
) -> int:
    """Index of a frame, counted from the first shown one.

    The best ones have the largest product of trust and the share of joints inside the images (mean
    over views, as far as there are cameras); of those it is the one with the person largest. Frames
    that are not captured or show nobody come last; without trust and cameras it is frame 0.

    Args:
        frames: F.
        trust: (F,), 0 to 1, or None.
        arrays: ``joints2d-K`` of view K, (F, 16, 2), pixels of the shown videos.
        views: their heights and widths.
        marks: stretches that stand out.
        first: number of the first shown frame in the video.
    """
    score = np.ones(frames) if trust is None else np.nan_to_num(trust, nan=0.0).astype(np.float64)
    seen = [
        _seen(arrays[f"joints2d-{view}"], size)
        for view, size in enumerate(views)
        if f"joints2d-{view}" in arrays
    ]
    extent = np.zeros(frames)
    if seen:
        score = score * np.mean([share for share, _ in seen], axis=0)
        extent = np.mean([size for _, size in seen], axis=0)
    for mark in marks:
        if mark.kind == "bad":
            score[mark.start - first : mark.stop - first] = -1.0
    best = score >= score.max() - _EQUAL
    return int(np.argmax(np.where(best, extent, -1.0)))


def _seen(
    pixels: NDArray[Any], size: dict[str, Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of the joints inside an image, and how much of its height or width they take."""
    with np.errstate(invalid="ignore"):
        inside = np.logical_and(pixels > 0, pixels < (size["width"], size["height"]))
    both = np.all(inside, axis=-1)  # F J
    known = np.where(both[..., None], pixels, np.nan)
    reach = np.zeros(len(pixels))
    some = both.sum(-1) > 1
    span = np.nanmax(known[some], 1) - np.nanmin(known[some], 1)
    reach[some] = (span / (size["width"], size["height"])).max(-1)
    return both.mean(-1), reach


# --- Arrays as text inside a page: concatenated, deflated, in base64 ------------------------------

_TYPES = {"uint8", "uint16", "int16", "uint32", "float32"}  # what a browser has arrays of
_ALIGNMENT = 4  # bytes: arrays in a browser start at multiples of their items' size


@dataclass(frozen=True)
class Pack:
    """Arrays in one piece of text.

    Attributes:
        text: base64 of the deflated bytes.
        entries: of each array by name: its type, its shape, and where it starts, for JSON.
    """

    text: str
    entries: dict[str, dict[str, Any]]


def pack(arrays: Mapping[str, NDArray[Any]]) -> Pack:
    """Put arrays together; little-endian, row by row.

    Raises:
        ValueError: an array of a type that browsers do not have.
    """
    entries: dict[str, dict[str, Any]] = {}
    parts: list[bytes] = []
    offset = 0
    for name, array in arrays.items():
        if array.dtype.name not in _TYPES:
            known = ", ".join(sorted(_TYPES))
            raise ValueError(f"{name} is {array.dtype}, expected one of {known}")
        data = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes()
        data += bytes(-len(data) % _ALIGNMENT)
        entries[name] = {"type": array.dtype.name, "shape": list(array.shape), "start": offset}
        parts.append(data)
        offset += len(data)
    deflated = zlib.compress(b"".join(parts), 9)
    return Pack(encode(deflated), entries)


def unpack(packed: Pack) -> dict[str, NDArray[Any]]:
    """The arrays of a pack, as a browser reads them."""
    data = zlib.decompress(base64.b64decode(packed.text))
    return {
        name: np.frombuffer(
            data, entry["type"], int(np.prod(entry["shape"], dtype=np.int64)), entry["start"]
        ).reshape(entry["shape"])
        for name, entry in packed.entries.items()
    }


def encode(data: bytes) -> str:
    """Base64, which needs no escaping in HTML."""
    return base64.b64encode(data).decode("ascii")


# --- What the viewer is given of a result: plain values, and arrays and files as text -------------


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
    joints = torch.from_numpy(result.joints)
    up = upright(joints, result.level)
    around = Surroundings.around(joints, result.shown, up, rows)
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
