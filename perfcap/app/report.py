"""``perfcap report`` and ``perfcap view``: a result as a page that plays in a browser."""

from __future__ import annotations

import logging
import webbrowser
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.app.capture_folder import for_everybody, named_people
from perfcap.app.console import PlainConsole, progress_bars
from perfcap.app.inputs import parse_frames
from perfcap.app.truth import find_truth, read_found, read_truth, require_rate
from perfcap.app.truth_doubts import joint_doubts
from perfcap.app.truth_people import own_truths
from perfcap.commands.results import Report
from perfcap.errors import InputError
from perfcap.io.result_folder import METRICS, MOTION, PAGE, REPORT, is_several
from perfcap.report import Places, Wanted, make_comparison, make_people_report, make_report

_LOG = logging.getLogger(__name__)


def run_report(request: Report) -> int:
    """Write the page and print where it is; of several people one each, and one of everybody.

    Returns the exit code.

    Raises:
        InputError: bad input, in one line; an older page is still there then.
    """
    truths: dict[Path, Path] = {}
    if request.truth is not None:
        people = [place for place, _ in named_people(request.folder)]
        truths = dict(zip(people, own_truths(people, request.truth), strict=True))

    def write(folder: Path, _: str) -> int:
        return _report(replace(request, folder=folder, truth=truths.get(folder)))

    code = for_everybody(request.folder, write)
    if is_several(request.folder):
        _told(write_people_report(request))
    return code


def _report(request: Report) -> int:
    page = write_report(request)
    stop = parse_frames(request.frames).stop
    last = int(read_found(request.folder / MOTION).frames[-1])
    if stop is not None and stop > last + 1:
        PlainConsole().print(f"--frames {request.frames}: the result ends with {last}")
    _told(page)
    return 0


def _told(page: Path) -> None:
    """Say where a page is."""
    size = page.stat().st_size / 1e6
    PlainConsole().print(f"{page} ({size:.1f} MB); perfcap view {page.parent} opens it")


def run_view(folders: tuple[Path, ...]) -> int:
    """Open the page of a result, made first where it is missing or older; of several people one.

    Older than the capture, or than what ``perfcap evaluate`` found since.

    Of two results it is one page that shows both, in the working directory.

    Raises:
        InputError: none or more than two results, or such that do not fit together.
    """
    if len(folders) == 1:
        return _view(folders[0])
    if len(folders) != 2:
        raise InputError(f"FOLDER: are {len(folders)}; expected one result, or two to compare")
    one, other = folders
    name = f"{one.resolve().name}_and_{other.resolve().name}.html"
    with progress_bars() as tell:
        page = make_comparison((one, other), Path(name), tell)
    PlainConsole().print(f"{page} ({page.stat().st_size / 1e6:.1f} MB)")
    _open(page)
    return 0


def _view(folder: Path) -> int:
    page = folder / PAGE
    shown = [each for each in (folder / REPORT, folder / METRICS) if each.is_file()]
    fresh = page.is_file() and folder / REPORT in shown
    if not fresh or any(page.stat().st_mtime < each.stat().st_mtime for each in shown):
        several, request = is_several(folder), Report(folder)
        page = write_people_report(request) if several else write_report(request)
    _open(page)
    return 0


def _open(page: Path) -> None:
    if not webbrowser.open(page.resolve().as_uri()):
        PlainConsole().print(f"no browser was found; open {page} in one")


def write_people_report(request: Report) -> Path:
    """Write ``report.html`` of everybody into a result's folder; returns its path.

    Raises:
        InputError: as ``make_people_report``.
    """
    part = parse_frames(request.frames)
    start = part.start if request.frames is not None else None
    wanted = Wanted(start, part.stop, Places(request.videos, request.cameras))
    with progress_bars() as tell:
        return make_people_report(request.folder, wanted, tell)


def write_report(request: Report) -> Path:
    """Write ``report.html`` into a result's folder; returns its path.

    Raises:
        InputError: as ``make_report``; or frames or a truth that cannot be read.
    """
    part = parse_frames(request.frames)
    truth, notes = _read_truth(request.truth, request.folder)
    wanted = Wanted(
        start=part.start if request.frames is not None else None,
        stop=part.stop,
        places=Places(request.videos, request.cameras),
        truth=truth,
        notes=notes,
    )
    with progress_bars() as tell:
        return make_report(request.folder, wanted, tell)


def _read_truth(
    path: Path | None, folder: Path
) -> tuple[dict[int, NDArray[np.float64]] | None, tuple[str, ...]]:
    """True joints (16, 3) m by number of the frame, as ``perfcap evaluate`` takes them.

    Returns:
        The joints, None without a path, and what looks wrong in them.
    """
    if path is None:
        return None, ()
    true, found = read_found(find_truth(path)), read_found(folder / MOTION)
    require_rate(found, true.fps, true.path)
    doubts = joint_doubts(found, replace(read_truth(path), strict=False))
    notes = tuple(f"--truth: {line}" for line in doubts)
    for line in notes:
        _LOG.warning("%s", line)
    return dict(zip(true.frames.tolist(), true.joints.numpy(), strict=True)), notes
