"""``report.html``: a result as one page that plays from disk."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from numbers import Integral
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.files import MEBIBYTE, read_json
from perfcap.io.result import Result, read_result
from perfcap.io.result_folder import METRICS, PAGE, own_file
from perfcap.metrics.missing import check_metres, check_places
from perfcap.pipeline.performance import Performance
from perfcap.report import sections
from perfcap.report.angles import read_angles
from perfcap.report.content import content
from perfcap.report.curves import Measured
from perfcap.report.markup import Markup
from perfcap.report.model import Model, build_model
from perfcap.report.page import assemble
from perfcap.report.sources import Places, find_sources
from perfcap.report.views import Views, build_views

LONGEST = 3000  # frames in a page
_METRICS_LIMIT = 4 * MEBIBYTE

# called with what is being done, how much of it is, and how much there is
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Wanted:
    """What a report shows.

    Attributes:
        start: number of the first frame in the video; the capture's first where None.
        stop: number after the last frame; the capture's last where None.
        places: where inputs lie now.
        truth: true joints by number of the frame, (16, 3) m each, or None.
        notes: what to say beside the result's own warnings, as of the truth.
    """

    start: int | None = None
    stop: int | None = None
    places: Places = field(default_factory=Places)
    truth: dict[int, NDArray[np.float64]] | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("start", "stop"):
            value = getattr(self, name)
            if value is not None and (isinstance(value, bool) or not isinstance(value, Integral)):
                raise InputError(f"wanted: {name} is {value!r:.80}, expected a frame's number")
        if not isinstance(self.places, Places) or not isinstance(self.truth, dict | None):
            kinds = type(self.places).__name__, type(self.truth).__name__
            raise InputError(
                f"wanted: places and truth are {' and '.join(kinds)}, expected Places and joints "
                "(16, 3) by the number of their frame, {0: ...}"
            )


def make_report(
    folder: str | Path, wanted: Wanted | None = None, progress: Progress | None = None
) -> Path:
    """Write ``report.html`` into the folder of a capture; returns its path.

    What is missing (the video, the surface, cameras) is left out, and the page says so.

    Raises:
        InputError: no folder of a finished capture, damaged files, inputs that were given and
            cannot be used, or a place that cannot be written.
    """
    page = build_page(folder, wanted, progress)
    path = Path(folder) / PAGE
    with writing(path) as file:
        file.write(page.encode("utf-8"))
    return path


def build_page(
    folder: str | Path, wanted: Wanted | None = None, progress: Progress | None = None
) -> str:
    """The page of a capture; see ``make_report``."""
    wanted = wanted or Wanted()
    if not isinstance(wanted, Wanted):
        kind = type(wanted).__name__
        raise InputError(f"wanted: is a {kind}, expected Wanted(start, stop, places, truth)")
    tell = progress or (lambda name, done, total: None)
    result = read_result(folder)
    rows, notes = wanted_rows(result, wanted)
    truth = _truth(result, rows, wanted)
    sources = find_sources(result, rows, wanted.places)
    model = build_model(result, rows)
    views = build_views(result, rows, sources, tell)
    return _page(
        result,
        rows,
        model,
        views,
        Measured(sources, truth, read_angles(result, rows)),
        [*notes, *wanted.notes, *model.notes, *sources.notes, *views.notes],
    )


def wanted_rows(result: Result, wanted: Wanted) -> tuple[slice, list[str]]:
    """The wanted frames of a result, and what to say where these are not all."""
    numbers = result.frame_numbers
    first, last = int(numbers[0]), int(numbers[-1])
    start = first if wanted.start is None else wanted.start
    stop = last + 1 if wanted.stop is None else wanted.stop
    inside = np.flatnonzero((numbers >= start) & (numbers < stop))
    if not len(inside):
        raise InputError(
            f"--frames {start}:{stop}: {result.folder} holds frames {first} to {last}; expected a "
            "part of them"
        )
    begin, end = int(inside[0]), int(inside[-1]) + 1
    notes = [f"The result ends with frame {last}."] if stop > last + 1 else []
    if end - begin <= LONGEST:
        return slice(begin, end), notes
    note = (
        f"Only the first {LONGEST} of {end - begin} frames are shown; perfcap report --frames A:B "
        "shows others."
    )
    return slice(begin, begin + LONGEST), [*notes, note]


def _truth(result: Result, rows: slice, wanted: Wanted) -> NDArray[np.float64] | None:
    if wanted.truth is None:
        return None
    numbers = [int(number) for number in result.frame_numbers[rows]]
    missing = [number for number in numbers if number not in wanted.truth]
    if missing:
        raise InputError(
            f"--truth: lacks {len(missing)} of the {len(numbers)} frames of {result.folder}, the "
            f"first is {missing[0]}; expected all of them"
        )
    joints = [np.asarray(wanted.truth[number], dtype=np.float64) for number in numbers]
    shapes = {each.shape for each in joints}
    if shapes != {(len(LANDMARKS), 3)}:
        raise InputError(
            f"--truth: frames have joints {sorted(shapes)}, expected ({len(LANDMARKS)}, 3) each"
        )
    found = np.stack(joints)
    check_metres(truth=torch.from_numpy(found))
    check_places(torch.from_numpy(found))
    return found


def _page(
    result: Result, rows: slice, model: Model, views: Views, measured: Measured, notes: list[str]
) -> str:
    shown = content(result, rows, model, views, measured)
    return assemble(
        shown.data["name"],
        _sections(result, rows, shown.marks, notes),
        shown.data,
        shown.blobs,
    )


def _sections(result: Result, rows: slice, found: list[Any], notes: list[str]) -> dict[str, Markup]:
    nothing, metrics = Markup(""), _metrics(result.folder)
    own, other = result.report.get("capture"), metrics.get("capture")
    if isinstance(own, str) and isinstance(other, str) and own != other:
        metrics = {}
        notes = [
            *notes,
            f"{METRICS} is of another capture, so that its errors are not shown; run "
            "perfcap evaluate again.",
        ]
    return {
        "summary": sections.summary(result, rows),
        "status": sections.status(result),
        "warnings": sections.warnings(result, found, notes),
        "metrics": sections.metrics_table(metrics) or nothing,
        "stages": sections.stages(result.report),
        "windows": sections.window_table(result.report) or nothing,
        "configuration": sections.configuration(result),
        "files": sections.files(result.folder),
    }


def _metrics(folder: Path) -> dict[str, Any]:
    """What ``perfcap evaluate`` wrote, if it did."""
    path = own_file(folder, METRICS)
    if path is None:
        return {}
    try:
        value = read_json(path, "what perfcap evaluate writes", _METRICS_LIMIT)
    except InputError:
        return {}
    return value if isinstance(value, dict) else {}


# --- A result inside a notebook -------------------------------------------------------------------


def show(
    result: Performance | str | Path,
    videos: Sequence[str | Path] = (),
    cameras: str | Path | None = None,
    *,
    height: int = 720,
) -> Any:
    """The page of ``perfcap report`` below a notebook's cell, to turn and to play.

    Args:
        result: of a capture, or the folder of one; nothing is written there.
        videos: one a view, to be seen behind the motion; those that a folder names otherwise.
        cameras: their calibration, likewise.
        height: of the picture, px.

    Raises:
        InputError: this is no notebook, or the result cannot be read.
    """
    try:
        display: Any = import_module("IPython.display")
    except ImportError as error:
        raise InputError("show is for notebooks; perfcap view opens a folder") from error
    if not isinstance(result, Performance | str | Path):
        kind = type(result).__name__
        raise InputError(
            f"show: got a {kind}, expected a Performance, or the folder of one; of several people "
            "show each"
        )
    places = Places(
        tuple(Path(each) for each in videos), None if cameras is None else Path(cameras)
    )
    with TemporaryDirectory() as scratch:
        folder = Path(scratch) / "capture" if isinstance(result, Performance) else Path(result)
        if isinstance(result, Performance):
            result.save(folder)
        page = build_page(folder, Wanted(places=places))
    style = f'allow="fullscreen" style="width: 100%; height: {int(height)}px; border: 0"'
    return display.HTML(f'<iframe title="perfcap" {style} srcdoc="{html.escape(page)}"></iframe>')
