"""The MonoPerfCap benchmark (Xu et al. 2018): 13 sequences of people in one view.

``NAME/calib.txt`` (a Skeletool camera file), ``NAME/images/`` or ``NAME/frames/``, and where there
is truth, ``NAME/ground_truth/`` of ``*.off`` (a surface a frame) or ``*.png`` (silhouettes drawn by
hand). No joints are published. Lengths are taken to be millimetres, as in the camera files.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.datasets.layout import check_name, matching, present, wrong_layout
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Mesh, Protocol
from perfcap.io.datasets.skeletool import read_skeletool
from perfcap.io.doctor.finding import counted
from perfcap.io.files import MEBIBYTE, read_text
from perfcap.metrics import Alignment

_TITLE = "the MonoPerfCap benchmark"
_LAYOUT = "NAME/calib.txt with NAME/images/ and, for some, NAME/ground_truth/*.off or *.png"
_RATE = 30.0
_SIZE = (1080, 1920)
_MILLIMETRE = 1e-3
_DIGITS = re.compile(r"[0-9]{1,9}")
_IMAGES = ("images", "frames")
_SEQUENCES = (
    *("Chenglei_studio", "Franzi_studio", "Helge_outdoor", "Nadia_outdoor", "Natalia_outdoor"),
    *("Oleks_outdoor", "Oleks_studio", "Pablo_outdoor", "Simeng_moving_cam", "Simeng_outdoor"),
    *("Simeng_studio", "Weipeng_outdoor", "Weipeng_studio"),
)


def list_monoperfcap(folder: Path) -> tuple[str, ...]:
    """Names of the sequences that are there."""
    found = [path.parent.name for path in matching(folder, "*/calib.txt")]
    if not found:
        raise wrong_layout(folder, _TITLE, "NAME/calib.txt", _LAYOUT)
    return tuple(found)


def read_monoperfcap(folder: Path, name: str) -> DatasetSequence:
    """One sequence; its truth is a file a frame, by the numbers in the names."""
    check_name(folder, _TITLE, name, list_monoperfcap(folder))
    place = folder / name
    meshes = matching(place, "ground_truth/*.off")
    masks = matching(place, "ground_truth/*.png")
    rig = read_skeletool(place / "calib.txt", _SIZE)
    frames, note = _numbers(place, meshes or masks)
    if meshes and masks and _numbers(place, masks)[0] != frames:
        raise InputError(
            f"{place / 'ground_truth'}: has {len(meshes)} *.off and {len(masks)} *.png of other "
            "frames; expected both of each frame, or one kind"
        )
    return DatasetSequence(
        dataset="monoperfcap",
        name=name,
        folder=place,
        frames=torch.tensor(frames, dtype=torch.int64),
        rate=_RATE,
        rig=rig.select([0]),
        videos=present([place / images for images in _IMAGES]),
        masks=tuple(masks),
        meshes=tuple(meshes),
        read_mesh=read_surface,
        warnings=(note, *rig.warnings),
    )


def _numbers(place: Path, truth: Sequence[Path]) -> tuple[list[int], str]:
    """The frame that each file of the truth shows, and how that is known."""
    if not truth:
        return [], f"{place}: has no ground_truth, so there is nothing to compare with"
    numbers = [_number(path) for path in truth]
    shown = [_number(path) for name in _IMAGES for path in matching(place, f"{name}/*")]
    images = [number for number in shown if number >= 0]
    if any(number < 0 for number in numbers) or len(set(numbers)) < len(numbers):
        return list(range(len(truth))), (
            "the truth is taken to be of every image from the first on, and in millimetres: its "
            "names have no numbers"
        )
    if len(set(images)) == len(images) and set(numbers) <= set(images):
        order = {number: frame for frame, number in enumerate(images)}
        return [order[number] for number in numbers], (
            "the truth is taken to be of the images of its numbers, and in millimetres"
        )
    first = numbers[0]
    gaps = numbers[-1] - first + 1 - len(numbers)
    return [number - first for number in numbers], (
        "the truth is taken to start with the first image and to be in millimetres"
        + (f"; by its numbers there is none of {counted(gaps)} between" if gaps else "")
    )


def _number(path: Path) -> int:
    """The last number in a file's name; -1 without one."""
    found = _DIGITS.findall(path.stem)
    return int(found[-1]) if found else -1


def read_surface(path: Path) -> Mesh:
    """A true surface: vertices (V, 3), metres, and triangles (T, 3).

    Raises:
        InputError: it is no OFF mesh.
    """
    vertices, faces = read_off(path)
    return _MILLIMETRE * vertices, faces


MONOPERFCAP = Dataset(
    name="monoperfcap",
    title=_TITLE,
    layout=_LAYOUT,
    protocol=Protocol(
        joints=(),
        alignments=(Alignment.TRANSLATION, Alignment.SIMILARITY),
        splits={"benchmark": _SEQUENCES},
        source="Xu et al. 2018, Sec. 6: surfaces after translation, silhouettes by overlap",
    ),
    list_names=list_monoperfcap,
    read_sequence=read_monoperfcap,
)


# --- OFF meshes: text with the number of vertices and faces, vertices, faces ----------------------

_LIMIT = 256 * MEBIBYTE
_MAX_VERTICES = 4_000_000
_WHAT = "an OFF mesh"


def read_off(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) in the file's unit and triangles (T, 3); polygons are cut into triangles.

    Raises:
        InputError: it is no such file.
    """
    lines = (line.split("#")[0] for line in read_text(path, _WHAT, _LIMIT).splitlines())
    words = [line.split() for line in lines if line.strip()]
    if not words or words[0][0] not in ("OFF", "COFF", "NOFF"):
        raise InputError(f"{path}: does not start with OFF; expected {_WHAT}")
    rows = [words[0][1:], *words[1:]] if len(words[0]) > 1 else words[1:]
    try:
        vertices, faces = (int(value) for value in rows[0][:2])
        if not (0 < vertices <= _MAX_VERTICES and faces > 0 and len(rows) > vertices + faces):
            raise InputError(
                f"{path}: says {vertices} vertices and {faces} faces in {len(rows)} lines; "
                f"expected {_WHAT}, whole"
            )
        points = np.array([[float(value) for value in row[:3]] for row in rows[1 : vertices + 1]])
        corners = [_corners(row) for row in rows[vertices + 1 : vertices + faces + 1]]
        triangles = np.array([t for polygon in corners for t in polygon], np.int64).reshape(-1, 3)
    except (ValueError, IndexError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: holds a line that is no {_WHAT[3:]} ({error})") from error
    if points.shape != (vertices, 3) or not np.isfinite(points).all():
        raise InputError(f"{path}: has vertices that are not three finite numbers")
    if not len(triangles) or triangles.min() < 0 or triangles.max() >= vertices:
        raise InputError(f"{path}: has faces of vertices that are not among the {vertices}")
    return points, triangles


def _corners(row: list[str]) -> list[tuple[int, int, int]]:
    """A polygon as a fan of triangles."""
    count = int(row[0])
    indices = [int(value) for value in row[1 : count + 1]]
    if count < 3 or len(indices) != count:
        raise ValueError(f"a face of {count} corners with {len(indices)} numbers")
    return [(indices[0], indices[i], indices[i + 1]) for i in range(1, count - 1)]
