"""The folder of a capture: what it may write over, and what it must not leave from before."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from stat import S_ISDIR, S_ISREG

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


def state_of(path: Path) -> str | None:
    """What becomes another when a file, or a file directly in a folder, is replaced or changed.

    Sizes and times of change, not contents: videos are large. None where nothing can be said: it
    cannot be read, or holds more files than anybody should wait for.
    """
    try:
        about = path.stat()
        if not S_ISDIR(about.st_mode):
            return f"{about.st_size} bytes of {about.st_mtime_ns}"
        with os.scandir(path) as entries:
            found: list[str] = []
            for entry in entries:
                if len(found) == _MOST_FILES:
                    return None
                known = entry.stat()
                if S_ISREG(known.st_mode):  # a folder in it may be that of the results
                    found.append(f"{entry.name}\0{known.st_size}\0{known.st_mtime_ns}")
    except OSError:
        return None
    digest = hashlib.sha256("\0".join(sorted(found)).encode(errors="surrogateescape"))
    return f"{len(found)} files, {digest.hexdigest()[:32]}"


def states_of(paths: Iterable[Path]) -> dict[str, str | None]:
    """The state of each of some inputs, by name."""
    return {str(path): state_of(path) for path in paths}


def unchanged(before: object, now: Mapping[str, str | None]) -> bool:
    """Whether all inputs are those that were written down, each in a known state."""
    return before == now and None not in now.values()


def _same(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other)
    except OSError:  # one of them is not there
        return False
