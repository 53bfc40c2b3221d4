"""Joint angles and trust of every frame, as charts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.io.archive import read_archive
from perfcap.io.result import Result
from perfcap.io.result_folder import MOTION
from perfcap.report.chart import Chart, Line

Floats = NDArray[np.float64]

_MOST = 1e6  # of an angle, radians: a damaged file holds anything
_CHARTS = 100  # of angles on a page
_SIDES = {"l": "left", "r": "right", "left": "left", "right": "right"}


@dataclass(frozen=True)
class Angles:
    """What ``motion.npz`` knows beyond joints; empty in results of older versions.

    Attributes:
        names: of the angles, A.
        values: (F, A), degrees.
        limits: least and most of each angle, (A, 2), degrees; NaN where there are none.
        trust: in each frame, (F,), 0 to 1, or None.
    """

    names: tuple[str, ...]
    values: Floats
    limits: Floats
    trust: Floats | None = None


NOTHING = Angles((), np.zeros((0, 0)), np.zeros((0, 2)))


def read_angles(result: Result, rows: slice) -> Angles:
    """Angles and trust of some frames of a result; what is damaged counts as missing.

    Raises:
        InputError: the archive cannot be read.
    """
    wanted = ("angles", "angle_names", "angle_lower", "angle_upper", "trust")
    found = read_archive(result.folder / MOTION, wanted, "the motion.npz of a capture")
    found = {n: v for n, v in found.items() if v.dtype.kind == ("U" if n == wanted[1] else "f")}
    frames = result.frames
    trust = found.get("trust")
    if trust is not None and trust.shape != (frames,):
        trust = None
    known = None if trust is None else np.clip(trust[rows].astype(np.float64), 0, 1)
    names, angles = found.get("angle_names"), found.get("angles")
    if names is None or angles is None or angles.shape != (frames, names.size):
        return Angles((), np.zeros((rows.stop - rows.start, 0)), np.zeros((0, 2)), known)
    none = np.full(names.size, np.nan)
    limits = [found.get(name, none) for name in ("angle_lower", "angle_upper")]
    pair = np.stack([each if each.shape == none.shape else none for each in limits], -1)
    values = np.where(np.abs(angles) < _MOST, angles, np.nan)[rows]
    listed = tuple(str(name) for name in names.ravel())
    return Angles(listed, np.degrees(values), np.degrees(pair), known)


def trust_chart(angles: Angles) -> Chart | None:
    """How probable it is that each frame is good."""
    if angles.trust is None:
        return None
    line = Line("trust", (100 * angles.trust).tolist())
    about = "Probability that the joints of a frame are right, from what the capture knows itself."
    return Chart("Trust", "%", (line,), about, worst="low")


def angle_charts(angles: Angles) -> list[Chart]:
    """A chart for each angle; those of the two sides share one."""
    groups: dict[str, list[Line]] = {}
    for index, name in enumerate(angles.names):
        side, rest = _parted(name)
        limits = (float(angles.limits[index, 0]), float(angles.limits[index, 1]))
        finite = np.isfinite(limits).all() and limits[0] < limits[1]
        line = Line(side, angles.values[:, index].tolist(), limits if finite else None)
        groups.setdefault(rest, []).append(line)
    return [_angle_chart(title, lines) for title, lines in list(groups.items())[:_CHARTS]]


def _angle_chart(title: str, lines: list[Line]) -> Chart:
    bounds = list(dict.fromkeys(line.limits for line in lines))
    worst = "limit" if any(bounds) else "high"
    told = [f"{low:.0f} to {high:.0f}°" for low, high in (b for b in bounds if b is not None)]
    about = f"Limits: {', '.join(told)}." if told else "Without limits."
    return Chart(title, "°", tuple(lines), about, worst=worst, group="angles")


def _parted(name: str) -> tuple[str, str]:
    """Side and title of an angle: ``l_knee_flexion`` is ``left`` of ``Knee flexion``."""
    words = [word for word in name.split("_") if word]
    ends = ((0, words[1:]), (-1, words[:-1])) if len(words) > 1 else ()
    for end, rest in ends:
        side = _SIDES.get(words[end].lower())
        if side is not None:
            return side, _title(rest)
    return "angle", _title(words) or "Angle"


def _title(words: list[str]) -> str:
    text = " ".join(words)
    return text[:1].upper() + text[1:]
