"""Rendered crops on disk: made once, in parts, and read in any order."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.files import read_json
from perfcap.train.scenes import Scenes, Shot

DESCRIPTION = "crops.json"
_GROUPS = 32  # in a part
_QUALITY = 92  # of JPEG
_KEPT = 256  # parts in memory
_ARRAYS = ("jpeg", "ends", "joints2d", "joints3d", "focal", "present", "parts")

Progress = Callable[[str, int, int], None]


class CropStore:
    """Shots by number, from files of some hundred each.

    Args:
        folder: that ``render_crops`` filled.

    Raises:
        InputError: it holds no crops, a part of them is missing, or what describes them is damaged.
    """

    def __init__(self, folder: Path) -> None:
        path = folder / DESCRIPTION
        if not path.is_file():
            raise InputError(f"{folder}: has no {DESCRIPTION}; expected a folder of rendered crops")
        described = _described(path)
        self._files = [folder / _name(part) for part in range(described["parts"])]
        self._each = int(described["each"])
        missing = [file for file in self._files if not file.is_file()]
        if missing:
            raise InputError(f"{missing[0]}: no such file; render the crops again to complete them")
        self._part = lru_cache(_KEPT)(_read_part)

    def __len__(self) -> int:
        return len(self._files) * self._each

    def __getitem__(self, number: int) -> Shot:
        """One shot.

        Raises:
            InputError: its part is damaged or holds NaN.
        """
        part, row = divmod(number, self._each)
        data = self._part(self._files[part])
        start = int(data["ends"][row - 1]) if row else 0
        image = cv2.imdecode(data["jpeg"][start : int(data["ends"][row])], cv2.IMREAD_COLOR_RGB)
        return Shot(
            np.asarray(image, np.uint8),
            data["joints2d"][row],
            data["joints3d"][row],
            float(data["focal"][row]),
            bool(data["present"][row]),
            np.asarray(data["parts"][row], np.uint8),
        )


def render_crops(
    folder: Path,
    scenes: Scenes,
    crops: int,
    described: dict[str, object],
    progress: Progress | None = None,
) -> CropStore:
    """Render what a folder lacks of a number of crops, rounded up to whole parts.

    What describes them is written first: parts that a killed call leaves are taken for those of
    its settings alone.

    Args:
        folder: made if need be.
        scenes: where crops come from.
        crops: how many.
        described: settings that the crops depend on; other ones are refused.
        progress: told what is done and what there is to do.

    Raises:
        InputError: the folder holds crops of other settings, or of unknown ones, as where what
            describes them is damaged.
    """
    group = scenes.group_size
    each = _GROUPS * group
    parts = -(-crops // each)
    text = json.dumps({"each": each, "settings": described}, sort_keys=True, default=str)
    _require_same(folder, text)
    folder.mkdir(parents=True, exist_ok=True)
    with writing(folder / DESCRIPTION) as file:
        file.write(json.dumps({"parts": parts, **json.loads(text)}, indent=1).encode())
    for part in range(parts):
        if progress is not None:
            progress("render", part, parts)
        if not (folder / _name(part)).is_file():
            numbers = range(part * _GROUPS, (part + 1) * _GROUPS)
            _write_part(folder / _name(part), [s for n in numbers for s in scenes.group(n)])
    return CropStore(folder)


def _require_same(folder: Path, text: str) -> None:
    """Refuse a folder whose crops are not known to be those that a text describes."""
    path = folder / DESCRIPTION
    if path.is_file():
        found = _described(path)
        found.pop("parts")
        if json.dumps(found, sort_keys=True) != text:
            raise InputError(
                f"{folder}: holds crops of other settings, actors, body model or backgrounds; give "
                "another folder or the same settings"
            )
    elif parts := sorted(folder.glob("crops_*.npz")):
        raise InputError(
            f"{folder}: holds {parts[0].name} but no {DESCRIPTION}, so that nobody knows of which "
            "settings its crops are; give another folder, or delete them"
        )


def _described(path: Path) -> dict[str, Any]:
    """What is written about crops: the number of parts, that of shots in each, and settings."""
    found = read_json(path, "what describes rendered crops")
    counts = [found.get(key) for key in ("parts", "each")] if isinstance(found, dict) else [None]
    if not all(type(count) is int and count > 0 for count in counts):
        raise InputError(
            f"{path}: has no numbers of parts and of crops in each; expected what a training wrote "
            "there; restore it, or give another folder"
        )
    return dict(found)


def _name(part: int) -> str:
    return f"crops_{part:04d}.npz"


def _write_part(path: Path, shots: Sequence[Shot]) -> None:
    coded = [_encoded(shot.image) for shot in shots]
    with writing(path) as file:
        np.savez(
            file,
            jpeg=np.concatenate(coded),
            ends=np.cumsum([len(code) for code in coded]),
            joints2d=np.stack([shot.joints2d for shot in shots]),
            joints3d=np.stack([shot.joints3d for shot in shots]),
            focal=np.array([shot.focal for shot in shots]),
            present=np.array([shot.present for shot in shots]),
            parts=np.stack([shot.parts for shot in shots]),
        )


def _encoded(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, code = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return np.asarray(code, np.uint8).reshape(-1)


def _read_part(path: Path) -> dict[str, NDArray[np.generic]]:
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in _ARRAYS}
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: is damaged ({error}); delete it and render again") from None
    if not all(np.isfinite(arrays[name]).all() for name in ("joints2d", "joints3d", "focal")):
        raise InputError(f"{path}: holds joints that are not finite; delete it and render again")
    return arrays
