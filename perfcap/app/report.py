"""``perfcap report`` and ``perfcap view``: a result as a page that plays in a browser."""

from __future__ import annotations

import webbrowser
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from perfcap.app.console import progress_bars
from perfcap.app.inputs import parse_frames
from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.pipeline.performance import REPORT
from perfcap.report import PAGE, Places, Wanted, make_report

_LANDMARKS = (16, 3)
_TRUTH_NAMES = ("truth.npz", "gt.npz")


@dataclass(frozen=True)
class ReportRequest:
    """What the command line asks for; see ``perfcap report --help``."""

    folder: Path
    videos: tuple[Path, ...] = ()
    cameras: Path | None = None
    truth: Path | None = None
    frames: str | None = None


def run_report(request: ReportRequest) -> int:
    """Write the page and print where it is; returns the exit code.

    Raises:
        InputError: bad input, in one line; an older page is still there then.
    """
    page = write_report(request)
    size = page.stat().st_size / 1e6
    Console().print(f"{page} ({size:.1f} MB); perfcap view {request.folder} opens it", markup=False)
    return 0


def run_view(folder: Path) -> int:
    """Open the page of a result, made first where it is missing or older than the result."""
    page, report = folder / PAGE, folder / REPORT
    fresh = page.is_file() and report.is_file()
    if not fresh or page.stat().st_mtime < report.stat().st_mtime:
        page = write_report(ReportRequest(folder))
    if not webbrowser.open(page.resolve().as_uri()):
        Console().print(f"no browser was found; open {page} in one", markup=False)
    return 0


def write_report(request: ReportRequest) -> Path:
    """Write ``report.html`` into a result's folder; returns its path.

    Raises:
        InputError: as ``make_report``; or frames or a truth that cannot be read.
    """
    part = parse_frames(request.frames)
    wanted = Wanted(
        start=part.start if request.frames is not None else None,
        stop=part.stop,
        places=Places(request.videos, request.cameras),
        truth=None if request.truth is None else _read_truth(request.truth),
    )
    with progress_bars() as tell:
        return make_report(request.folder, wanted, tell)


def _read_truth(path: Path) -> dict[int, NDArray[np.float64]]:
    """True joints (16, 3) m by number of the frame, as ``perfcap evaluate`` takes them."""
    if path.is_dir():
        found = [path / name for name in _TRUTH_NAMES if (path / name).is_file()]
        path = found[0] if found else path / _TRUTH_NAMES[0]
    values = read_archive(path, ("joints3d", "frames"), "an npz with joints3d")
    joints = values.get("joints3d")
    if joints is None or joints.shape[1:] != _LANDMARKS or not np.isfinite(joints).all():
        found_shape = "missing" if joints is None else f"of shape {joints.shape} or not finite"
        raise InputError(f"{path}: joints3d is {found_shape}, expected (F, 16, 3) in metres")
    numbers = values.get("frames", np.arange(len(joints)))
    if numbers.shape != joints.shape[:1] or numbers.dtype.kind not in "iu":
        raise InputError(f"{path}: frames is {numbers.shape}, expected {len(joints)} numbers")
    return dict(zip(numbers.tolist(), joints.astype(np.float64), strict=True))
