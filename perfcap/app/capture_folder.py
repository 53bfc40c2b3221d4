"""The folder of a capture: what it may write over, and what it must not leave from before."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.result_folder import ABOUT, DETECTIONS, FILES, MASKS, SURFACE

_MOST_FILES = 1_000_000  # that are looked at in one folder


def spare_inputs(folder: Path, inputs: Iterable[Path], detected: bool) -> None:
    """Refuse a capture that would write over what it reads, or remove it.

    Args:
        folder: of the results.
        inputs: files and folders that are read.
        detected: whether ``detections.npz`` is written too.

    Raises:
        InputError: an input has the place of a result.
    """
    names = (*FILES, SURFACE, MASKS, *ABOUT, *((DETECTIONS,) if detected else ()))
    for path in inputs:
        for name in names:
            if _same(path, folder / name):
                raise InputError(
                    f"--out {folder}: {name} of the result would replace the input {path}; choose "
                    "another folder"
                )


def last_change(path: Path) -> float:
    """When a file, or a folder or a file directly in it, was last changed, seconds.

    Infinite for a folder of more files than anybody should wait for.

    Raises:
        OSError: it is not there.
    """
    newest = path.stat().st_mtime
    if not path.is_dir():
        return newest
    with os.scandir(path) as entries:
        for count, entry in enumerate(entries):
            if count == _MOST_FILES:
                return math.inf
            if entry.is_file():  # a folder in it may be that of the results
                newest = max(newest, entry.stat().st_mtime)
    return newest


def _same(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other)
    except OSError:  # one of them is not there
        return False
