"""TRC files: named markers over time, as Pose2Sim and OpenSim write them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.datasets.layout import MAX_FRAMES
from perfcap.io.files import read_text
from perfcap.rates import FASTEST, SLOWEST

_WHAT = "a TRC file: five lines of header, then a line a frame"
_LAST = 10**9 - 1  # of the frames' numbers, as in names of other data sets' files
_UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers of a file, in its own axes.

    Attributes:
        names: M.
        points: (F, M, 3), metres, NaN where nothing was measured.
        frames: as the file numbers them, (F,).
        rate: frames a second, if known.
        warnings: what a user should know.
    """

    names: tuple[str, ...]
    points: NDArray[np.float64]
    frames: NDArray[np.int64]
    rate: float | None
    warnings: tuple[str, ...] = ()


def read_trc(path: Path) -> Markers:
    """Read the markers of a file.

    Raises:
        InputError: it is no such file.
    """
    lines = read_text(path, _WHAT).splitlines()
    if len(lines) < 6:
        raise InputError(f"{path}: has {len(lines)} lines, expected {_WHAT}")
    # cells are kept where they are empty: a tab between two tabs is a marker that is missing
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    names = tuple(name for name in lines[3].split("\t")[2:] if name.strip())
    rate, unit = _number(path, header.get("DataRate")), header.get("Units", "")
    if not names or not SLOWEST <= rate < FASTEST or unit not in _UNITS:
        raise InputError(
            f"{path}: says {len(names)} markers, DataRate {rate:g}, Units {unit!r:.10}; expected "
            "markers in m or mm"
        )
    if lines[4].partition("\t")[0].strip().isdecimal():  # a frame would be skipped
        raise InputError(
            f"{path}: frames begin in line 5 ({lines[4]!r:.30}), expected {_WHAT}; the fifth names "
            "the axes, X1, Y1, Z1: add it"
        )
    rows = [_row(path, line, len(names)) for line in lines[5:] if line.strip()]
    if not 0 < len(rows) <= MAX_FRAMES:
        raise InputError(f"{path}: has {len(rows)} frames, expected 1 to {MAX_FRAMES}")
    table = np.array(rows)
    numbers = table[:, 0]
    rising = not np.any(numbers % 1) and not np.any(np.diff(numbers) <= 0)
    if not rising or numbers[0] < 0 or numbers[-1] > _LAST:
        raise InputError(
            f"{path}: frames are numbered {', '.join(f'{n:g}' for n in numbers[:4])}, ..., "
            f"{numbers[-1]:g}; expected whole numbers from 0 to {_LAST} that grow from line to line"
        )
    points = _UNITS[unit] * table[:, 2:].reshape(len(rows), len(names), 3)
    return Markers(
        tuple(name.strip() for name in names),
        points,
        table[:, 0].astype(int),
        rate,
        tuple(_missing(path, header, numbers, len(names))),
    )


def _missing(
    path: Path, header: Mapping[str, str], numbers: NDArray[np.float64], markers: int
) -> Iterator[str]:
    """That a file ends, in frames or markers, before its header says.

    Of a part of a video frames keep their numbers, and a header may count those before it.
    """
    last = int(numbers[-1] - min(numbers[0], 1)) + 1
    for key, found in (("NumFrames", max(len(numbers), last)), ("NumMarkers", markers)):
        promised = header.get(key, "")
        if promised.isdecimal() and len(promised) < 10 and int(promised) > found:
            yield f"{path.name}: says {key} {int(promised)} and has {found}; is it whole?"


def _row(path: Path, line: str, markers: int) -> list[float]:
    cells = line.rstrip("\r\n").split("\t")
    width = 2 + 3 * markers
    if len(cells) < width or any(cell.strip() for cell in cells[width:]):
        raise InputError(
            f"{path}: frame {cells[0]!s:.12} has {len(cells)} cells, expected {width}: a number, "
            "a time, and x, y, z of each marker"
        )
    values = [_number(path, cell) for cell in cells[:width]]
    if not np.isfinite(values[:2]).all():
        raise InputError(f"{path}: a frame is without a number or a time")
    return values


def _number(path: Path, text: str | None) -> float:
    if text is None or not text.strip():
        return float("nan")
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"{path}: holds {text!r:.20} where a number should be") from error
