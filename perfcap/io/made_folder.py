"""The folder that a command writes into: made if need be, held by one process, gone if unused."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.atomic import unwritable
from perfcap.io.files import named_path
from perfcap.io.result_folder import locked


@contextmanager
def made_folder(folder: str | Path) -> Iterator[Path]:
    """A folder, made if need be, that no other process writes into meanwhile.

    However the block ends, folders that were made for it and hold nothing are removed.

    Raises:
        InputError: it cannot be made or written, or another process writes there.
    """
    path = named_path(folder, "folder", "a folder to write to")
    made: list[Path] = []
    try:
        _make(path, made)
        with locked(path):
            yield path
    finally:
        for place in made:
            with suppress(OSError, ValueError):  # holds something, or was never made
                place.rmdir()


def _make(folder: Path, made: list[Path]) -> None:
    """Make a folder and those above it; ``made`` lists them, the deepest first."""
    try:
        for place in (folder, *folder.parents):
            if place.exists():
                break
            made.append(place)
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {unwritable(folder, error)}") from error
    except ValueError as error:  # a name that no file can have
        raise InputError(
            f"--out {folder}: cannot be written ({error}); choose another place"
        ) from None
    if not os.access(folder, os.W_OK):
        raise InputError(f"--out {folder}: the folder is not writable; choose another place")
