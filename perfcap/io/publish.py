"""A folder that receives all files of a command, or none."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeGuard

from perfcap.errors import InputError
from perfcap.io.atomic import settle, unwritable, writing
from perfcap.io.files import read_json
from perfcap.io.made_folder import made_folder

WORK = ".perfcap-new"  # where files grow; gone once they are in their places
_NEW, _OLD, _PLAN = "new", "old", "publish.json"
_SEPARATORS = ("/", "\\", "\0")


def _nothing(folder: Path) -> Collection[str]:
    return ()


@contextmanager
def publishing(folder: Path, gone: Callable[[Path], Collection[str]] = _nothing) -> Iterator[Path]:
    """A scratch folder whose files and folders move into ``folder`` when the block ends well.

    Where it does not, nothing of it stays: neither the scratch folder, nor folders made for it.
    What a killed call left is removed, or put into its place if it was complete.

    Args:
        folder: made if need be.
        gone: names of files in the folder that tell of what is replaced; those that are not written
            anew are removed in the same step.

    Raises:
        InputError: the place cannot be written, another process writes there, or a folder there
            holds other things.
    """
    with made_folder(folder):
        yield from _publishing(folder, gone)


def _publishing(folder: Path, gone: Callable[[Path], Collection[str]]) -> Iterator[Path]:
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
        names = [entry.name for entry in entries]
        plan = _Plan(names, [name for name in gone(folder) if name not in names])
        with writing(work / _PLAN) as file:
            file.write(json.dumps(asdict(plan)).encode())
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
    plan = _Plan.read(work / _PLAN)
    for name in plan.names:
        if (work / _NEW / name).exists():
            _move(work / _NEW / name, folder / name, work / _OLD)
    for name in plan.gone:
        if (folder / name).is_file():  # never a folder, which no call has put there
            (folder / name).unlink()
    settle(folder)
    (work / _PLAN).unlink()
    _remove(work)


@dataclass(frozen=True)
class _Plan:
    """What is to happen in the folder.

    Attributes:
        names: of files and folders that move into it.
        gone: of files that leave it.
    """

    names: list[str]
    gone: list[str]

    @classmethod
    def read(cls, path: Path) -> _Plan:
        values = read_json(path, "what was about to be put into place")
        parts = (
            values if isinstance(values, dict) else {"names": values, "gone": []}
        )  # of older versions
        names, gone = parts.get("names"), parts.get("gone")
        if not (_are_plain(names) and _are_plain(gone)):
            raise InputError(f"{path}: is damaged; remove the folder {path.parent}")
        return cls(names, gone)


def _are_plain(names: object) -> TypeGuard[list[str]]:
    """Whether they are a list of names of what lies directly in a folder."""
    return isinstance(names, list) and all(
        isinstance(name, str) and name not in ("", ".", "..") and not any(
            separator in name for separator in _SEPARATORS
        )
        for name in names
    )  # fmt: skip


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
