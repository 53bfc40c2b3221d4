"""Landmarks or bones as marker trajectories: TRC and C3D."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.export.options import Options, ascii_label, unique_names, word
from perfcap.io.export.recording import Recording

Floats = NDArray[np.float64]

_MOST_FRAMES = 65_535  # a C3D header counts with 16 bits
_BLOCK, _DATA_START = 512, 8  # bytes of the header; its word that says where points begin
_DECIMALS = 8  # of a metre in TRC, fewer in smaller units
_TRC_FIELDS = (
    "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames"
)


@dataclass(frozen=True, eq=False)
class Markers:
    """Named points in motion, (F, M, 3), in the unit of the file."""

    names: tuple[str, ...]
    places: Floats


def choose_markers(recording: Recording, options: Options, clean: Callable[[str], str]) -> Markers:
    """The markers that the options ask for, their names as the format takes them."""
    if options.markers == "bones":
        names, places = recording.template.bone_names, recording.posed_bones[..., :3, 3]
    else:
        names, places = LANDMARKS, recording.landmarks
    return Markers(unique_names(names, clean), places * options.per_metre)


def write_trc(folder: Path, recording: Recording, options: Options) -> None:
    """Tab-separated text; frames and times are those of the video, frames counted from 1."""
    markers = choose_markers(recording, options, word)
    name, rate = f"{recording.name}.trc", f"{recording.rate:.9g}"
    frames, count = markers.places.shape[:2]
    counted = recording.numbers + 1  # as the format does
    values = (rate, rate, frames, count, options.unit, rate, counted[0], frames)
    axes = [f"{axis}{number + 1}" for number in range(count) for axis in "XYZ"]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{word(name)}",
        _TRC_FIELDS.replace(" ", "\t"),
        "\t".join(map(str, values)),
        "Frame#\tTime\t" + "\t\t\t".join(markers.names) + "\t\t",
        "\t\t" + "\t".join(axes),
    ]
    digits = _DECIMALS - round(np.log10(options.per_metre))
    for number, time, row in zip(
        counted, recording.times, markers.places.reshape(frames, -1), strict=True
    ):
        lines.append(f"{number}\t{time:.9f}\t" + "\t".join(f"{x:.{digits}f}" for x in row))
    with writing(folder / name) as file:
        file.write(("\n".join(lines) + "\n").encode())


def write_c3d(folder: Path, recording: Recording, options: Options) -> None:
    """Points of a C3D file, with the vertical axis and the frame numbers of the video stated."""
    if recording.numbers[-1] + 1 > _MOST_FRAMES:
        raise InputError(
            f"--to c3d: frame {recording.numbers[-1]} is beyond the {_MOST_FRAMES} that the format "
            "counts; export fewer with --frames A:B"
        )
    markers = choose_markers(recording, options, ascii_label)
    path = folder / f"{recording.name}.c3d"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import ezc3d

        file = ezc3d.c3d()
        point = file["parameters"]["POINT"]
        point["RATE"]["value"] = [recording.rate]
        point["LABELS"]["value"] = markers.names
        point["UNITS"]["value"] = [options.unit]
        vertical = "+Z" if recording.axes[2, 1] > 0.5 else "+Y"
        file.add_parameter("POINT", "X_SCREEN", ["+X"])
        file.add_parameter("POINT", "Y_SCREEN", [vertical])
        homogeneous = np.ones((4, len(markers.names), recording.frames))
        homogeneous[:3] = markers.places.transpose(2, 1, 0)
        file["data"]["points"] = homogeneous
        first = int(recording.numbers[0])
        file["header"]["points"]["first_frame"] = first
        file["header"]["points"]["last_frame"] = first + recording.frames - 1
        with suppress(OSError, RuntimeError):
            file.write(str(path))
    if not _is_whole(path, markers):
        raise InputError(f"{path}: cannot be written; free space or choose another folder")


def _is_whole(path: Path, markers: Markers) -> bool:
    """Whether all points reached the disk: the library writes on without a word when it is full."""
    if not path.is_file() or path.stat().st_size < _BLOCK:
        return False
    header = np.fromfile(path, "<u2", _BLOCK // 2)
    start = _BLOCK * (int(header[_DATA_START]) - 1)
    return path.stat().st_size >= start + 16 * markers.places[..., 0].size
