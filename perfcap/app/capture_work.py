"""What a capture has finished before it was stopped, and which call it belongs to."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import torch

from perfcap import __version__
from perfcap.errors import InputError
from perfcap.io.atomic import unwritable, writing
from perfcap.io.files import read_json
from perfcap.io.result_folder import WORK, own_file, require_places, tidy
from perfcap.pipeline.checkpoint import SUFFIX, Checkpoint

_PLACE, _CALL = "checkpoint", "call.json"
_FREE = ("out", "overlay")  # options that change no block


@dataclass(frozen=True)
class Call:
    """All that decides about the bits of a result.

    Attributes:
        options: of the command.
        inputs: names of files and folders that are read, and the state of each.
        versions: of what computes.
    """

    options: Mapping[str, Any]
    inputs: Mapping[str, str | None]
    versions: Mapping[str, str]

    @classmethod
    def of(cls, options: Mapping[str, Any], inputs: Mapping[str, str | None]) -> Self:
        """The call with these options, on inputs in these states."""
        kept = {name: value for name, value in options.items() if name not in _FREE}
        versions = {"perfcap": __version__, "torch": torch.__version__}
        return cls(kept, inputs, versions)

    def plain(self) -> dict[str, Any]:
        """As it is read back from a file."""
        values: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return values

    def difference(self, other: Any) -> str:
        """What of it is different in a call that was written down, in words; empty if nothing."""
        if other == self.plain() and None not in self.inputs.values():
            return ""
        for part, values in self.plain().items():
            theirs = other.get(part) if isinstance(other, dict) else None
            known = theirs if isinstance(theirs, dict) else {}
            names = [n for n in {*values, *known} if values.get(n) != known.get(n)]
            if part == "inputs":  # whose state cannot be told may have changed
                names += [n for n, state in values.items() if state is None and n not in names]
            if names:
                return f"{part}: {', '.join(sorted(names))}"
        return "another version"


def find_work(folder: Path, call: Call, resume: bool, overwrite: bool) -> Checkpoint | None:
    """The unfinished work of this very call, where ``--resume`` asks for it.

    Raises:
        InputError: there is work that would be lost.
    """
    place = folder / WORK / _PLACE
    if not _has_blocks(place):
        return None
    values = _read_call(place)
    differs = call.difference(values.get("call"))
    if resume and not differs:
        return Checkpoint(place, checked=True)
    if overwrite:
        return None
    if differs:
        raise InputError(
            f"--out {folder}: holds an unfinished capture that differs in {differs}; go on with it "
            "by its own options and --resume, or start over with --overwrite"
        )
    raise InputError(
        f"--out {folder}: holds an unfinished capture of this call; go on with --resume, or start "
        "over with --overwrite"
    )


def begin_work(folder: Path, call: Call, overwrite: bool) -> Checkpoint:
    """A new place for finished work; older work there is dropped.

    Raises:
        InputError: the folder cannot be written.
    """
    require_places(folder)
    place = folder / WORK / _PLACE
    try:
        if place.is_symlink():
            place.unlink()
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
    except OSError as error:
        raise unwritable(place, error) from error
    with writing(place / _CALL) as file:
        file.write(json.dumps({"call": call.plain(), "overwrite": overwrite}).encode())
    return Checkpoint(place, checked=True)


def drop_if_empty(work: Checkpoint) -> None:
    """Leave nothing where nothing was finished."""
    if work.folder is not None and work.folder.is_dir() and not _has_blocks(work.folder):
        shutil.rmtree(work.folder, ignore_errors=True)
        tidy(work.folder.parent.parent)


def _has_blocks(place: Path) -> bool:
    if place.is_symlink() or not place.is_dir():
        return False
    return any(entry.suffix == SUFFIX and entry.stat().st_size for entry in place.iterdir())


def _read_call(place: Path) -> dict[str, Any]:
    path = own_file(place, _CALL)
    values = {} if path is None else read_json(path, "what a capture was asked for")
    return values if isinstance(values, dict) else {}
