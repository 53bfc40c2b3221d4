"""A folder that receives all files of an export, or none."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.atomic import partial_path, unwritable


@contextmanager
def publishing(folder: Path) -> Iterator[Path]:
    """A scratch folder whose files and folders move into ``folder`` when the block ends well.

    Where it does not, nothing of it stays: neither the scratch folder, nor folders made for it.

    Raises:
        InputError: the place cannot be written, or a folder there holds other things.
    """
    made = _make(folder)
    scratch = partial_path(folder / "export")
    try:
        scratch.mkdir()
        yield scratch
        entries = sorted(scratch.iterdir())
        for entry in entries:
            _check_place(entry, folder / entry.name)
        for entry in entries:
            _move(entry, folder / entry.name)
    except OSError as error:
        raise unwritable(folder, error) from error
    except InputError as error:
        # users know the folder that they named, not where files grow
        raise InputError(str(error).replace(str(scratch), str(folder))) from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        for place in made:
            with suppress(OSError):  # holds what was exported
                place.rmdir()


def _make(folder: Path) -> list[Path]:
    """Make a folder and those above it; returns what was made, the deepest first."""
    missing = []
    try:
        for place in (folder, *folder.parents):
            if place.exists():
                break
            missing.append(place)
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error
    return missing


def _check_place(entry: Path, target: Path) -> None:
    """Refuse to replace what an older export cannot have written."""
    if not target.exists():
        return
    if entry.is_dir() != target.is_dir():
        kind = "a folder" if target.is_dir() else "a file"
        raise InputError(f"{target}: is {kind} already; remove it or choose another folder")
    if entry.is_dir():
        ours = {item.suffix for item in entry.iterdir()}
        for item in target.iterdir():
            if item.is_dir() or item.suffix not in ours:
                raise InputError(
                    f"{target}: holds {item.name}, which no export wrote; remove it or choose "
                    "another folder"
                )


def _move(entry: Path, target: Path) -> None:
    if entry.is_dir() and target.exists():
        old = entry.with_name(f"{entry.name}.old")
        os.replace(target, old)  # a folder cannot be replaced in one step
    os.replace(entry, target)
