"""A folder that receives all files of a command, or none."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.atomic import settle, unwritable, writing
from perfcap.io.files import read_json
from perfcap.io.made_folder import made_folder

WORK = ".perfcap-new"  # where files grow; gone once they are in their places
_NEW, _OLD, _PLAN = "new", "old", "publish.json"
_SEPARATORS = ("/", "\\", "\0")


@contextmanager
def publishing(folder: Path) -> Iterator[Path]:
    """A scratch folder whose files and folders move into ``folder`` when the block ends well.

    Where it does not, nothing of it stays: neither the scratch folder, nor folders made for it.
    What a killed call left is removed, or put into its place if it was complete.

    Raises:
        InputError: the place cannot be written, another process writes there, or a folder there
            holds other things.
    """
    with made_folder(folder):
        yield from _publishing(folder)


def _publishing(folder: Path) -> Iterator[Path]:
    work = folder / WORK
    scratch = work / _NEW
    try:
        _finish(folder)
        _remove(work)
        scratch.mkdir(parents=True)
        (work / _OLD).mkdir()  # now, since a full disk would refuse it between two moves
        yield scratch
        entries = sorted(scratch.iterdir())
        for entry in entries:
            _check_place(entry, folder / entry.name)
        settle(scratch)
        with writing(work / _PLAN) as file:
            file.write(json.dumps([entry.name for entry in entries]).encode())
        settle(work)
        _finish(folder)
    except OSError as error:
        raise unwritable(folder, error) from error
    except InputError as error:
        # users know the folder that they named, not where files grow
        raise InputError(str(error).replace(str(scratch), str(folder))) from error
    finally:
        if not (work / _PLAN).is_file():  # else the next call puts into place what is complete
            with suppress(OSError):
                _remove(work)


def _finish(folder: Path) -> None:
    """Put complete files into their places; also where somebody was killed while doing so."""
    work = folder / WORK
    if work.is_symlink() or not (work / _PLAN).is_file():
        return
    for name in _names(work / _PLAN):
        if (work / _NEW / name).exists():
            _move(work / _NEW / name, folder / name, work / _OLD)
    settle(folder)
    (work / _PLAN).unlink()
    _remove(work)


def _names(plan: Path) -> Collection[str]:
    names = read_json(plan, "what was about to be put into place")
    plain = isinstance(names, list) and all(
        isinstance(name, str) and name not in ("", ".", "..") and not any(
            separator in name for separator in _SEPARATORS
        )
        for name in names
    )  # fmt: skip
    if not plain:
        raise InputError(f"{plan}: is damaged; remove the folder {plan.parent}")
    return list(names)


def _check_place(entry: Path, target: Path) -> None:
    """Refuse to replace what an older call cannot have written."""
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


def _move(entry: Path, target: Path, old: Path) -> None:
    if entry.is_dir() and target.exists():
        _remove(old / entry.name)
        os.replace(target, old / entry.name)  # a folder cannot be replaced in one step
    os.replace(entry, target)


def _remove(path: Path) -> None:
    """A folder, a file or a link; links are not followed."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
