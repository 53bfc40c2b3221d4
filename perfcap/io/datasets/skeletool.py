"""Camera files of the graphics group in Saarbrücken (``Skeletool Camera Calibration File V1.0``).

MPI-INF-3DHP and the MonoPerfCap benchmark come with them: blocks of lines that start with a word,
a camera each. Matrices are 4x4, row by row; ``extrinsic`` maps world to camera, millimetres.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.view import View, make_view
from perfcap.io.files import MEBIBYTE, read_text

_LIMIT = 8 * MEBIBYTE
_MILLIMETRE = 1e-3
_KEYS = ("name", "sensor", "size", "animated", "intrinsic", "extrinsic", "radial")
_WHAT = "a Skeletool camera file"


def read_skeletool(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """All cameras of a file.

    Args:
        path: the file.
        size: image (height, width) where the file does not say.

    Raises:
        InputError: it is no such file, or a camera in it cannot be one.
    """
    blocks: list[dict[str, list[str]]] = []
    for line in read_text(path, _WHAT, _LIMIT).splitlines():
        key, *values = line.split() or [""]
        if key not in _KEYS:
            continue
        if not blocks or key == "name" or key in blocks[-1]:
            blocks.append({})  # files of one camera may do without its name
        blocks[-1][key] = values
    if not blocks:
        raise InputError(
            f"{path}: has no line 'intrinsic'; expected {_WHAT}, with intrinsic and extrinsic, "
            "16 numbers each"
        )
    views = [_view(path, number, block, size) for number, block in enumerate(blocks)]
    curved = [
        view.name for view, block in zip(views, blocks, strict=True) if _is_curved(path, block)
    ]
    note = (
        f"{path}: camera {', '.join(curved)} has a radial distortion, whose model is not "
        "published: it is left out; expected 'radial 0', so straighten the images first"
    )
    return make_rig(str(path), views, warnings=(note,) if curved else ())


def _is_curved(path: Path, block: dict[str, list[str]]) -> bool:
    """Whether a camera has a distortion: ``radial``, with its terms if there are any."""
    return bool(_numbers(f"{path}", "radial", block).any())


def _view(
    path: Path, number: int, block: dict[str, list[str]], size: tuple[int, int] | None
) -> View:
    name = " ".join(block.get("name", [])) or str(number)
    where = f"{path}: camera {name}"
    if block.get("animated", ["0"])[:1] not in (["0"], []):
        raise InputError(f"{where}: is animated, expected a camera that stands still")
    if "size" in block:
        width, height = _numbers(where, "size", block, 2)
        size = (int(height), int(width))
    extrinsic = _numbers(where, "extrinsic", block, 16).reshape(4, 4)
    return make_view(
        where,
        name,
        intrinsics=_numbers(where, "intrinsic", block, 16).reshape(4, 4)[:3, :3],
        rotation=extrinsic[:3, :3],
        translation=_MILLIMETRE * extrinsic[:3, 3],
        size=size,
    )


def _numbers(
    where: str, key: str, block: dict[str, list[str]], count: int | None = None
) -> NDArray[np.float64]:
    try:
        numbers = np.array([float(value) for value in block.get(key, [])])
    except ValueError as error:
        raise InputError(f"{where}: {key} holds something that is no number") from error
    if not np.isfinite(numbers).all():
        raise InputError(f"{where}: {key} holds NaN or infinity, expected numbers")
    if count is not None and len(numbers) != count:
        raise InputError(f"{where}: {key} has {len(numbers)} numbers, expected {count}")
    return numbers
