"""Two results of the same frames as one page."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.files import named_path
from perfcap.io.result import Result, read_result
from perfcap.report import sections
from perfcap.report.angles import read_angles
from perfcap.report.content import Content, content
from perfcap.report.curves import Measured, joint_distances
from perfcap.report.make import LONGEST, Progress
from perfcap.report.markup import Markup, element, join
from perfcap.report.model import build_model
from perfcap.report.page import COMPARISON, assemble
from perfcap.report.sources import Sources, find_sources
from perfcap.report.views import Views, build_views

Folders = tuple[str | Path, str | Path]
Plain = dict[str, Any]

_LOG = logging.getLogger(__name__)
_SIZE = re.compile(r"\d+ bytes\b")  # of a file, in its state in run.json
_RATE = 1e-3  # share by which rates of the same video may differ


def make_comparison(folders: Folders, path: str | Path, progress: Progress | None = None) -> Path:
    """Write a page that plays two results side by side; returns its path.

    The video, and what is drawn over it, are those of the first one.

    Args:
        folders: of two captures of the same frames.
        path: of the page.
        progress: called with what is being done, how much of it is done, and how much there is.

    Raises:
        InputError: no such captures, other frames or rates, or a place that cannot be written.
    """
    path = named_path(path, "path", "the page to write")
    page = build_comparison(folders, progress)
    with writing(path) as file:
        file.write(page.encode("utf-8"))
    return path


def build_comparison(folders: Folders, progress: Progress | None = None) -> str:
    """The page of two captures; see ``make_comparison``."""
    if isinstance(folders, str | Path) or len(folders) != 2:
        raise InputError(f"folders: got {folders!r:.80}, expected those of two results")
    one, other = read_result(folders[0]), read_result(folders[1])
    _require_same_frames(one, other)
    _warn_of_other_videos(one, other)
    rows = slice(0, min(one.frames, LONGEST))
    sources = find_sources(one, rows)
    views = build_views(one, rows, sources, progress or (lambda name, done, total: None))
    left, notes = _content(one, rows, views, sources, "a-")
    right, more = _content(other, rows, Views(), find_sources(other, rows), "b-")
    if rows.stop < one.frames:
        notes = [f"Only the first {LONGEST} of {one.frames} frames are shown.", *notes]
    about = "Mean distance of the 16 landmarks of one result from those of the other."
    apart = joint_distances("Distance between A and B", one.joints[rows], other.joints[rows], about)
    data = {
        key: left.data[key] for key in ("name", "first", "frames", "opening", "rate", "marks")
    } | {
        "charts": [apart.plain(), *merged({"A": left.data["charts"], "B": right.data["charts"]})],
        "results": [left.data, right.data],
    }
    names = _names(one.folder, other.folder)
    data["name"] = f"{names[0]} and {names[1]}"
    parts = {
        "name_a": _label("A", names[0]),
        "name_b": _label("B", names[1]),
        "about_a": _about("A", names[0], one, rows, left, notes),
        "about_b": _about("B", names[1], other, rows, right, more),
    }
    return assemble(data["name"], parts, data, left.blobs | right.blobs, COMPARISON)


def _require_same_frames(one: Result, other: Result) -> None:
    spans = [f"frames {r.frame_numbers[0]} to {r.frame_numbers[-1]}" for r in (one, other)]
    if one.frame_numbers.tolist() != other.frame_numbers.tolist():
        raise InputError(
            f"{other.folder}: holds {other.frames} frames, {spans[1]}, {one.folder} {one.frames}, "
            f"{spans[0]}; expected two results of the same frames: capture both with the same "
            "--frames"
        )
    if abs(other.rate / one.rate - 1) > _RATE:
        raise InputError(
            f"{other.folder}: runs at {other.rate:.4g} frames a second, {one.folder} at "
            f"{one.rate:.4g}; expected two results of one rate"
        )


def _warn_of_other_videos(one: Result, other: Result) -> None:
    """Frames that are numbered alike may be of another film; those of other cameras are not."""
    first, second = _videos(one), _videos(other)
    if first and second and not any(_alike(a, b) for a in first.items() for b in second.items()):
        shown = {path: Path(path).name for path in (*first, *second)}
        if len(set(shown.values())) < len(shown):
            shown = {path: path for path in shown}  # their names are the same
        named = [", ".join(shown[path] for path in videos) for videos in (first, second)]
        _LOG.warning(
            "%s: was captured from %s, %s from %s; distances say something only where both show "
            "the same motion",
            *(one.folder, named[0], other.folder, named[1]),
        )


def _videos(result: Result) -> dict[str, str]:
    """Videos of a capture, and the size of each where it is known."""
    request, states = (result.report.get(key) for key in ("request", "input_files"))
    found = request.get("videos") if isinstance(request, dict) else None
    texts = found if isinstance(found, list) else ()
    known = states if isinstance(states, dict) else {}
    sizes = {path: _SIZE.match(str(known.get(path))) for path in texts if isinstance(path, str)}
    return {path: size[0] if size else "" for path, size in sizes.items()}


def _alike(one: tuple[str, str], other: tuple[str, str]) -> bool:
    """Whether two videos may be one, whose folder and time may be others by now: many are called
    like the camera they are from.
    """
    same = Path(one[0]).name == Path(other[0]).name
    return same and (not one[1] or not other[1] or one[1] == other[1])


def _content(
    result: Result, rows: slice, views: Views, sources: Sources, prefix: str
) -> tuple[Content, list[str]]:
    """A result for the viewer, and what is missing of it."""
    model = build_model(result, rows)
    measured = Measured(sources, angles=read_angles(result, rows))
    notes = [*model.notes, *sources.notes, *views.notes]
    found = content(result, rows, model, views, measured, prefix)
    for view in found.data["views"]:
        if "video" in view:
            view["video"] = prefix + view["video"]
    return found, notes


def merged(charts: Mapping[str, list[Plain]]) -> list[Plain]:
    """Charts of several results, those of one title together; lines say whose they are."""
    order = list(dict.fromkeys((c["group"], c["title"]) for own in charts.values() for c in own))
    found = []
    for key in order:
        chart: Plain = {}
        for letter, own in charts.items():
            for each in own:
                if (each["group"], each["title"]) == key:
                    lines = [*chart.get("lines", []), *_of(letter, each)]
                    worst = "lowest" if each["worst"] == "low" else each["worst"]
                    chart = {**each, **chart, "lines": lines, "stacked": False, "worst": worst}
        found.append(chart)
    return found


def _of(letter: str, chart: Plain) -> list[Plain]:
    """Lines of a chart under the name of their result; those that add up become their sum."""
    if not chart["stacked"]:
        single = len(chart["lines"]) == 1
        names = [letter if single else f"{letter}: {line['name']}" for line in chart["lines"]]
        return [{**line, "name": n} for line, n in zip(chart["lines"], names, strict=True)]
    columns = zip(*(line["values"] for line in chart["lines"]), strict=True)
    sums = [None if None in column else float(f"{sum(column):.4g}") for column in columns]
    return [{"name": f"{letter}: sum", "values": sums}]


def _names(one: Path, other: Path) -> tuple[str, str]:
    """What to call two folders: their names, with the folder above where these are the same."""
    first, second = one.resolve(), other.resolve()
    if first.name != second.name:
        return first.name, second.name
    return f"{first.parent.name}/{first.name}", f"{second.parent.name}/{second.name}"


def _label(letter: str, name: str) -> Markup:
    return join([element("b", letter, class_="badge"), " ", name])


def _about(
    letter: str, name: str, result: Result, rows: slice, shown: Content, notes: list[str]
) -> Markup:
    """Facts and warnings of one of the results."""
    return join(
        [
            element("h2", _label(letter, name), id=f"{letter.lower()}-title"),
            sections.status(result),
            sections.summary(result, rows),
            sections.warnings(result, shown.marks, notes),
        ]
    )
