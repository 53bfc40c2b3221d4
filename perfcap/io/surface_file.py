"""``surface.npz``: the vertices of every frame of a deforming surface, written and read in blocks.

The file is an ordinary npz archive for anybody's ``numpy.load``. Its arrays are stored without
compression (vertices in motion hardly shrink), so that they can be mapped into memory and a clip
of any length is written and read a few frames at a time.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.archive import map_archive
from perfcap.io.atomic import writing
from perfcap.io.files import MEBIBYTE
from perfcap.io.written_checks import frame_numbers, require_metres, warn_of_rate
from perfcap.rates import FASTEST, SLOWEST, frame_rate

WHAT = "the surface.npz of a capture"
LIMIT = 64 * 1024 * MEBIBYTE  # mapped, never loaded whole
BLOCK = 16  # frames

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SurfaceFile:
    """A surface on disk.

    Attributes:
        path: of the file.
        vertices: world, (F, V, 3) float32 m, read-only and mapped, not loaded; not yet known to
            be finite.
        faces: (T, 3) int64.
        frames: numbers of the frames in the video, (F,) int64.
        rate: frames a second.
        capture: identity of the capture, where the file says so.
    """

    path: Path
    vertices: Floats
    faces: NDArray[np.int64]
    frames: NDArray[np.int64]
    rate: float
    capture: str | None = None

    def read(self, span: slice) -> Floats:
        """Vertices of a span of frames, (f, V, 3) m, a copy.

        Raises:
            InputError: they are not all finite.
        """
        block = np.array(self.vertices[span])
        if not np.isfinite(block).all():
            raise InputError(f"{self.path}: vertices hold NaN or infinity; capture again")
        return block

    def blocks(self, size: int = BLOCK) -> Iterator[Floats]:
        """All frames in order, ``size`` at a time."""
        for start in range(0, len(self.vertices), size):
            yield self.read(slice(start, start + size))


def save_surface(
    path: Path,
    blocks: Iterable[NDArray[Any]],
    faces: NDArray[Any],
    frames: NDArray[Any],
    rate: float,
    capture: str | None = None,
    *,
    examined: bool = False,
) -> None:
    """Write a surface in constant memory; the file appears complete or not at all.

    Args:
        path: where to write.
        blocks: vertices in the world, (f, V, 3) m each, of consecutive frames; F in all.
        faces: (T, 3).
        frames: numbers of the frames in the video, (F,).
        rate: frames a second.
        capture: identity of the capture that the surface belongs to.
        examined: whether the caller has looked at the rate; else one of no recording is warned of.

    Raises:
        InputError: blocks that do not fit, are not finite or not in metres, frames that do not
            rise, a rate that is none, or a place that cannot be written.
    """
    rate = frame_rate(rate)
    if not examined:
        warn_of_rate(rate, level=2)
    small: dict[str, NDArray[Any]] = {
        "faces": np.asarray(faces, dtype=np.int32),
        "frames": frame_numbers(frames),
        "fps": np.array(float(rate)),
    }
    if capture is not None:
        small["capture"] = np.array(capture)
    save_vertices(path, _metres(blocks), len(frames), small)


def _metres(blocks: Iterable[NDArray[Any]]) -> Iterator[NDArray[Any]]:
    for block in blocks:
        require_metres(np.asarray(block), "surface")
        yield block


def save_vertices(
    path: Path, blocks: Iterable[NDArray[Any]], frames: int, others: Mapping[str, NDArray[Any]]
) -> None:
    """Write an npz archive of ``vertices`` (F, V, 3) float32 and other arrays, in constant memory.

    Args:
        path: where to write; the file appears complete or not at all.
        blocks: vertices of consecutive frames, (f, V, 3) each.
        frames: F.
        others: further arrays by name.

    Raises:
        InputError: as ``save_surface``.
    """
    with writing(path) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        with archive.open(_member("vertices"), "w", force_zip64=True) as member:
            _write_blocks(member, blocks, frames)
        for name, array in others.items():
            with archive.open(_member(name), "w") as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def open_surface(path: Path) -> SurfaceFile:
    """Open a surface; its vertices stay in the file until they are read.

    Raises:
        InputError: it is missing, damaged, or holds something else.
    """
    arrays = map_archive(path, "vertices", ("faces", "frames", "fps", "capture"), WHAT, LIMIT)
    vertices, faces = arrays.get("vertices"), arrays.get("faces")
    if vertices is None or vertices.ndim != 3 or vertices.shape[2] != 3 or not vertices.size:
        raise _unexpected(path, "vertices", vertices, "(F, V, 3) metres")
    if vertices.dtype != np.float32:
        raise _unexpected(path, "vertices", vertices, "float32")
    if faces is None or faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise _unexpected(path, "faces", faces, "(T, 3) integers")
    if faces.size and not 0 <= faces.min() <= faces.max() < vertices.shape[1]:
        raise _unexpected(path, "faces", faces, f"indices below {vertices.shape[1]}")
    frames = arrays.get("frames", np.arange(len(vertices)))
    if frames.shape != (len(vertices),) or frames.dtype.kind not in "iu":
        raise _unexpected(path, "frames", frames, f"{len(vertices)} frame numbers")
    rate = _rate(path, arrays.get("fps"))
    numbers = frames.astype(np.int64)
    known = read_identity(arrays.get("capture"))
    return SurfaceFile(path, vertices, faces.astype(np.int64), numbers, rate, known)


def read_identity(value: NDArray[Any] | None) -> str | None:
    """Which capture an array file belongs to; None where it says nothing of use."""
    if value is None or value.dtype.kind != "U" or value.shape != ():
        return None
    return str(value)


def _member(name: str) -> zipfile.ZipInfo:
    """A member without the time of day: equal surfaces make equal files."""
    member = zipfile.ZipInfo(f"{name}.npy")
    member.external_attr = 0o644 << 16  # as numpy has it, readable once unpacked
    return member


def _write_blocks(member: IO[bytes], blocks: Iterable[NDArray[Any]], frames: int) -> None:
    """One array from many blocks: its header, which states the number of frames, comes first."""
    written, shape = 0, (0, 0, 0)
    for block in blocks:
        values = np.ascontiguousarray(block, dtype="<f4")
        if not written:
            shape = (frames, *values.shape[1:])
            header = {"descr": "<f4", "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_1_0(member, header)
        if values.ndim != 3 or values.shape[1:] != shape[1:] or values.shape[2] != 3:
            raise InputError(
                f"surface: frame {written} has shape {values.shape[1:]}, expected (vertices, 3), "
                "the same for every frame"
            )
        finite = np.isfinite(values).all((1, 2))
        if not finite.all():
            bad = written + int(finite.argmin())
            raise InputError(f"surface: frame {bad} has vertices that are not finite")
        member.write(values.data)
        written += len(values)
    if written != frames or not frames:
        raise InputError(f"surface: {written} frames of vertices for {frames} frame numbers")


def _rate(path: Path, value: NDArray[Any] | None) -> float:
    plain = value is not None and value.size == 1 and value.dtype.kind in "fiu"
    if value is None or not plain or not SLOWEST <= value.reshape(()) < FASTEST:
        raise _unexpected(path, "fps", value, "a positive number")
    return float(value.reshape(()))


def _unexpected(path: Path, name: str, found: NDArray[Any] | None, expected: str) -> InputError:
    text = "missing" if found is None else f"{found.dtype} {found.shape}"
    return InputError(f"{path}: {name} is {text}, expected {expected}; capture again")
