"""Several people as one page: everybody in one scene, over one video."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import torch

from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.files import MEBIBYTE, named_path, read_json
from perfcap.io.result import Result, read_result
from perfcap.io.result_folder import PAGE, PEOPLE, REPORT, own_file, people_of
from perfcap.metrics.contact import skin_gap
from perfcap.pipeline.surroundings import shared_up, upright
from perfcap.render.projected_mesh import vertex_normals
from perfcap.report import sections
from perfcap.report.angles import read_angles
from perfcap.report.chart import Chart, Line
from perfcap.report.compare import Plain, merged
from perfcap.report.content import Content, content
from perfcap.report.curves import Measured
from perfcap.report.make import Progress, Wanted, wanted_rows
from perfcap.report.marks import Mark
from perfcap.report.markup import Markup, element, join
from perfcap.report.model import build_model
from perfcap.report.page import assemble
from perfcap.report.sources import Places, find_sources
from perfcap.report.views import build_views

_LIMIT = 64 * MEBIBYTE  # of run.json and people.json
_COLUMNS = {
    "actor": "actor",
    "frames_seen": "frames seen",
    "views_a_frame": "views a frame",
    "identity_margin_m": "next candidate, m (median; least)",
    "bones_differ": "bones differ by",
    "bones_margin": "the next actor's by",
}


def make_people_report(
    folder: str | Path, wanted: Wanted | None = None, progress: Progress | None = None
) -> Path:
    """Write ``report.html`` into the folder of a capture of several people; returns its path.

    Args:
        folder: of the capture, with the people's folders in it.
        wanted: frames, and where inputs lie now; each person's own page has errors.
        progress: called with what is being done, how much of it is done, and how much there is.

    Raises:
        InputError: no such capture, damaged files, or a place that cannot be written.
    """
    folder = named_path(folder, "folder", "the folder of a capture of several people")
    page = build_people_page(folder, wanted or Wanted(), progress)
    path = folder / PAGE
    with writing(path) as file:
        file.write(page.encode("utf-8"))
    return path


def build_people_page(folder: Path, wanted: Wanted, progress: Progress | None = None) -> str:
    """The page of several people; see ``make_people_report``."""
    results = [read_result(place) for place in people_of(folder)]
    first = results[0]
    if len(results) < 2:
        raise InputError(f"{folder}: is a capture of one person; perfcap report shows it")
    if any(each.frame_numbers.tolist() != first.frame_numbers.tolist() for each in results):
        raise InputError(f"{folder}: people have other frames each; run perfcap capture again")
    rows, notes = wanted_rows(first, wanted)
    tell = progress or (lambda name, done, total: None)
    shown = []
    for number, result in enumerate(results, 1):
        found, missing = _content(result, rows, wanted.places, tell, number)
        shown.append(found)
        notes += [line for line in missing if line not in notes]
    marks = list(_marks(shown))
    people = [torch.from_numpy(each.joints) for each in results]
    ups = [upright(joints, each.level) for joints, each in zip(people, results, strict=True)]
    data = {key: shown[0].data[key] for key in ("first", "frames", "opening", "rate")}
    data |= {
        "scene": shown[shared_up(people, ups)].data["scene"],
        "name": folder.resolve().name,
        "views": shown[0].data["views"],
        "marks": [mark.plain() for mark in marks],
        "charts": [
            _contact(results, rows).plain(),
            *merged({str(k): each.data["charts"] for k, each in enumerate(shown, 1)}),
        ],
        "people": [_own(each.data) for each in shown],
    }
    blobs = {name: text for each in shown for name, text in each.blobs.items()}
    return assemble(data["name"], _sections(folder, results, rows, marks, notes), data, blobs)


def _content(
    result: Result, rows: slice, places: Places, tell: Progress, number: int
) -> tuple[Content, list[str]]:
    """A person for the viewer, and what is missing; the first one brings the videos."""
    sources, model = find_sources(result, rows, places), build_model(result, rows)
    views = build_views(result, rows, sources, tell, videos=number == 1)
    measured = Measured(sources, angles=read_angles(result, rows))
    found = content(result, rows, model, views, measured, f"p{number}-")
    for view in found.data["views"]:
        if "video" in view:
            view["video"] = f"p{number}-{view['video']}"
    return found, [*model.notes, *sources.notes, *views.notes]


def _own(data: Mapping[str, Any]) -> Plain:
    """What of a person's data is not everybody's."""
    return {key: data[key] for key in ("name", "arrays", "surface", "texture") if key in data}


def _marks(shown: Sequence[Content]) -> Iterator[Mark]:
    """Frames that stand out, with whose they are."""
    for number, each in enumerate(shown, 1):
        for mark in each.marks:
            yield replace(mark, text=f"person {number}: {mark.text}")


def _contact(results: Sequence[Result], rows: slice) -> Chart:
    """How near each two people come."""
    faces = [torch.as_tensor(each.template.faces.copy()) for each in results]
    pairs = list(combinations(range(len(results)), 2))
    gaps: dict[tuple[int, int], list[float]] = {pair: [] for pair in pairs}
    for frame in range(rows.start, rows.stop):
        skins = []
        for each, triangles in zip(results, faces, strict=True):
            vertices = torch.as_tensor(each.shown[frame : frame + 1])[0].double()
            skins.append((vertices.numpy(), vertex_normals(vertices, triangles).numpy()))
        for one, other in pairs:
            gaps[one, other].append(1000 * skin_gap(skins[one], skins[other]))
    about = (
        "Smallest distance between the skins of two people; below 0, how deep one is in another."
    )
    lines = tuple(Line(f"{a + 1} and {b + 1}", gaps[a, b]) for a, b in pairs)
    return Chart("Between people", "mm", lines, about, worst="lowest")


def _sections(
    folder: Path, results: Sequence[Result], rows: slice, marks: list[Mark], notes: list[str]
) -> dict[str, Markup]:
    report = _read(folder, REPORT, "the report of a capture")
    told = [*_texts(report.get("warnings"))]
    for number, each in enumerate(results, 1):
        told += [f"person {number}: {line}" for line in _texts(each.report.get("warnings"))]
    everybody = replace(results[0], report={**report, "warnings": told, "input_warnings": []})
    named = f"{len(results)} people"
    about = replace(results[0], report={**results[0].report, "request": {"actor": named}})
    good = all(each.report.get("complete") is True for each in results)
    return {
        "summary": sections.summary(about, rows),
        "status": sections.status(replace(everybody, report={"complete": good})),
        "warnings": sections.warnings(everybody, marks, notes),
        "metrics": _who(folder),
        "stages": sections.stages(report),
        "windows": Markup(""),
        "configuration": sections.configuration(results[0]),
        "files": join([_links(folder), sections.files(folder)]),
    }


def _who(folder: Path) -> Markup:
    """Who is who, and how surely."""
    listed = _read(folder, PEOPLE, "the people of a capture").get("people")
    people = [each for each in listed if isinstance(each, dict)] if isinstance(listed, list) else []
    there = [key for key in _COLUMNS if any(key in each for each in people)]
    head = element(
        "tr",
        element("th", "person", scope="col"),
        [element("th", _COLUMNS[key], scope="col") for key in there],
    )
    rows = [
        element(
            "tr",
            element("th", number, scope="row"),
            [element("td", _cell(key, each.get(key))) for key in there],
        )
        for number, each in enumerate(people, 1)
    ]
    table = element("table", element("thead", head), element("tbody", rows), class_="numbers")
    return join([element("h3", "Who is who"), table])


def _cell(key: str, value: Any) -> str:
    """What a table says of a person; an actor's file by its name and that of its folder."""
    if key != "actor" or not isinstance(value, str):
        return _text(value)
    return "/".join(Path(value).with_suffix("").parts[-2:])


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return "; ".join(_text(value.get(key)) for key in ("median", "lowest_percent"))
    if isinstance(value, float):
        return f"{value:.3g}" if np.isfinite(value) else ""
    return "" if value is None else str(value)


def _links(folder: Path) -> Markup:
    """The people's own pages, or their folders where there is none."""
    items = []
    for number, place in enumerate(people_of(folder), 1):
        own = own_file(place, PAGE) is not None
        to = f"{place.name}/{PAGE}" if own else f"{place.name}/"
        items.append(element("li", element("a", f"Person {number} alone", href=quote(to))))
    return element("ul", items, class_="files")


def _read(folder: Path, name: str, what: str) -> dict[str, Any]:
    path = own_file(folder, name)
    values = None if path is None else read_json(path, what, _LIMIT)
    return values if isinstance(values, dict) else {}


def _texts(value: Any) -> list[str]:
    return [each for each in value if isinstance(each, str)] if isinstance(value, list) else []
