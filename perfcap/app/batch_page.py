"""What came of a batch: a page with a picture of every clip, and a table."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import numpy as np

from perfcap.app.batch_clip import INCOMPLETE, Outcome
from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.files import read_json
from perfcap.io.result_folder import OVERLAY, PAGE, REPORT, SCENE, own_file, people_of
from perfcap.io.video import VideoFile
from perfcap.report.markup import Content, Markup, element

INDEX, SUMMARY, PICTURES = "index.html", "summary.csv", "pictures"
_STATES = ("done", "gaps", "failed", "waiting")
_HEIGHT = 180  # px of a picture
_COLUMNS = ("name", "state", "people", "frames", "mean_trust", "not_trusted", "warnings",
            "seconds", "tries", "message", "folder")  # fmt: skip
_STYLE = (
    "body{font:15px system-ui,sans-serif;margin:2em;color:#222;background:#fff}"
    "table{border-collapse:collapse}th,td{padding:.4em .8em;text-align:left;"
    "border-bottom:1px solid #ddd;vertical-align:middle}img{display:block;height:90px}"
    ".failed{color:#a40000}.gaps{color:#8a5a00}"
)


@dataclass(frozen=True)
class ClipSummary:
    """A line of the table.

    Attributes:
        name: of the clip, and of its folder.
        state: done, gaps, failed or waiting.
        values: the other columns, by name.
    """

    name: str
    state: str
    values: dict[str, Any]


def summarize(folder: Path, name: str, outcome: Outcome | None) -> ClipSummary:
    """What is to be said of a clip."""
    if outcome is None:
        return ClipSummary(name, "waiting", {"folder": name})
    state = "failed" if not outcome.captured else "gaps" if outcome.code == INCOMPLETE else "done"
    values: dict[str, Any] = {
        "seconds": round(outcome.seconds, 1),
        "tries": outcome.tries,
        "message": outcome.message,
        "folder": name,
    }
    if outcome.captured:
        values |= _of_result(folder / name)
    return ClipSummary(name, state, values)


def _of_result(folder: Path) -> dict[str, Any]:
    """Frames, trust and warnings of a result, summed over people."""
    try:
        reports = [read_json(place / REPORT, "the report of a capture")
                   for place in people_of(folder)]  # fmt: skip
        whole = read_json(folder / REPORT, "the report of a capture")
    except InputError:
        return {}
    reports = [report for report in reports if isinstance(report, dict)]
    judged = [q for report in reports if isinstance(q := report.get("quality"), dict)]
    trust = [q["mean_trust"] for q in judged if isinstance(q.get("mean_trust"), float | int)]
    return {
        "people": len(reports),
        "frames": max((_count(r.get("frames")) for r in reports), default=0),
        "mean_trust": round(sum(trust) / len(trust), 3) if trust else None,
        "not_trusted": sum(_doubted(q) for q in judged),
        "warnings": _warnings(whole, reports),
    }


def _warnings(whole: object, people: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """What the capture warned of: of its inputs, of the result, and of every person in it."""
    lines: list[object] = []
    for report in (whole, *people):
        for key in ("input_warnings", "warnings"):
            found = report.get(key) if isinstance(report, dict) else None
            lines += found if isinstance(found, list) else []
    return tuple(dict.fromkeys(line for line in lines if isinstance(line, str)))


def _count(value: object) -> int:
    if isinstance(value, list):
        return len(value)
    return value if isinstance(value, int) else 0


def _doubted(quality: dict[str, Any]) -> int:
    """Frames that are not to be trusted."""
    ranges = quality.get("not_trusted")
    spans = [each.get("frames") for each in ranges if isinstance(each, dict)] if isinstance(
        ranges, list) else []  # fmt: skip
    return sum(span[1] - span[0] for span in spans
               if isinstance(span, list) and len(span) == 2
               and all(isinstance(end, int) for end in span))  # fmt: skip


def draw_picture(folder: Path, name: str) -> None:
    """A frame from the middle of a clip's overlay, where there is one."""
    overlay = own_file(folder / name, OVERLAY)
    if overlay is None:
        return
    try:
        video = VideoFile(overlay)
        middle = len(video) // 2
        frame = np.asarray(video.read(middle, middle + 1))[0]
        video.close()
    except InputError:
        return
    width = max(1, round(_HEIGHT * frame.shape[1] / frame.shape[0]))
    small = cv2.resize(frame, (width, _HEIGHT), interpolation=cv2.INTER_AREA)
    good, data = cv2.imencode(".jpg", small[..., ::-1])
    if good:
        (folder / PICTURES).mkdir(exist_ok=True)
        with writing(folder / PICTURES / f"{name}.jpg") as file:
            file.write(data.tobytes())


def write_pages(folder: Path, clips: Sequence[ClipSummary]) -> None:
    """``summary.csv`` and ``index.html``."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(_COLUMNS)
    for clip in clips:
        values = {**clip.values, "name": clip.name, "state": clip.state}
        if "warnings" in values:
            values["warnings"] = len(values["warnings"])
        table.writerow([_cell(values.get(column)) for column in _COLUMNS])
    with writing(folder / SUMMARY) as file:
        file.write(text.getvalue().encode())
    with writing(folder / INDEX) as file:
        file.write(_page(folder, clips).encode())


def _cell(value: object) -> object:
    """Text that no spreadsheet takes for a formula."""
    if isinstance(value, str) and value[:1] in ("=", "+", "-", "@"):
        return f"'{value}"
    return "" if value is None else value


def _page(folder: Path, clips: Sequence[ClipSummary]) -> str:
    count = {
        s: sum(clip.state == s for clip in clips) for s in ("done", "gaps", "failed", "waiting")
    }
    words = ", ".join(f"{number} {state}" for state, number in count.items() if number)
    heads = ("picture", "clip", "state", "frames", "trust", "doubted", "seconds", "open",
             "warnings")  # fmt: skip
    rows = (_row(folder, clip) for clip in clips)
    main = element(
        "main",
        element("h1", f"{len(clips)} clips: {words}"),
        element("table", element("tr", *(element("th", head) for head in heads)), *rows),
    )
    policy = "default-src 'none'; img-src 'self'; style-src 'unsafe-inline'"
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name="viewport", content="width=device-width"),
        element("title", f"{folder.name} · perfcap"),
        Markup(f"<style>{_STYLE}</style>"),
    )
    return f"<!doctype html>{element('html', head, element('body', main), lang='en')}"


def _row(folder: Path, clip: ClipSummary) -> Markup:
    values = clip.values
    picture = f"{PICTURES}/{clip.name}.jpg"
    own = clip.state in ("done", "gaps")  # else what is there is of an earlier call
    shown = own and own_file(folder, picture) is not None
    image = element("img", src=quote(picture), alt=f"a frame of {clip.name}") if shown else None
    trust = values.get("mean_trust")
    said = values.get("message") or clip.state
    return element(
        "tr",
        element("td", image),
        element("td", clip.name),
        element("td", said, class_=clip.state),
        element("td", values.get("frames")),
        element("td", None if trust is None else f"{100 * trust:.0f} %"),
        element("td", values.get("not_trusted")),
        element("td", values.get("seconds")),
        element("td", _links(folder, clip.name, own)),
        element("td", *(element("div", line) for line in values.get("warnings", ()))),
    )


def _links(folder: Path, name: str, own: bool) -> Iterable[Content]:
    """To what there is of a clip; results that are not of this line of the list are named so."""
    try:
        people = people_of(folder / name)
    except InputError:
        people = (folder / name,)
    places = [*((place, PAGE) for place in people), (folder / name, OVERLAY),
              (folder / name, SCENE), (folder / name, "capture.glb")]  # fmt: skip
    there = [(place, file) for place, file in places if own_file(place, file) is not None]
    if there and not own:
        yield "an earlier result: "
    for place, file in there:
        target = (place / file).relative_to(folder).as_posix()
        yield element("a", file, href=quote(target))
        yield Markup(" ")
