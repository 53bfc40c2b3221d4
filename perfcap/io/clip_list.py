"""A list of clips to capture: a CSV with a line for each, columns named like options."""

from __future__ import annotations

import csv
import difflib
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, read_text

_LIMIT = 16 * MEBIBYTE
_MOST = 100_000  # clips
_LONGEST = 80  # bytes of a name
_NAME = "name"
_NUMBER = re.compile(r"-[\d.]+")


@dataclass(frozen=True)
class ListedClip:
    """A line of the list.

    Attributes:
        name: of the clip, good as that of a folder, unlike those of all others.
        values: what its columns say, without those left empty; parts of a cell apart.
    """

    name: str
    values: Mapping[str, tuple[str, ...]]


def read_clip_list(
    path: Path,
    columns: Collection[str],
    paths: Collection[str],
    either: Collection[str] = (),
    reserved: Collection[str] = (),
) -> tuple[ListedClip, ...]:
    """Read a CSV whose first line names columns; cells hold several values apart by semicolons.

    A column ``name`` says what a clip is called, else its first video does; later ones of the same
    name are numbered. Paths are relative to the folder of the list.

    Args:
        path: the file.
        columns: that may be in it.
        paths: which of them hold paths; ``videos`` must be among them.
        either: which of them hold paths or names: paths are those that are there.
        reserved: names that no clip can have.

    Raises:
        InputError: it cannot be read, or names what is not known; says in which line.
    """
    what = "a CSV of clips, a line each, whose first line names columns such as videos"
    text = read_text(path, what, _LIMIT)
    try:
        rows = list(csv.reader(text.splitlines(), strict=True))
    except csv.Error as error:
        raise InputError(f"{path}: is no CSV ({error}); expected {what}") from None
    header = [cell.strip().replace("-", "_") for cell in rows[0]] if rows else []
    _check_header(path, header, (_NAME, *columns), what)
    clips: dict[str, ListedClip] = {}
    for number, row in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) > len(header):
            raise InputError(
                f"{path}: line {number} has {len(row)} cells under {len(header)} columns; put "
                "quotes around cells that hold commas"
            )
        if len(row) < len(header):
            raise InputError(
                f"{path}: line {number} has {len(row)} cells under {len(header)} columns; what is "
                "not given is an empty cell"
            )
        given = dict(zip(header, row, strict=True))
        values = {
            key: _parts(path, number, key, cell)
            for key, cell in given.items()
            if key != _NAME and cell.strip()
        }
        for key in {*paths, *either} & values.keys():
            values[key] = tuple(_beside(path, part, key in paths) for part in values[key])
        if not values.get("videos"):
            raise InputError(f"{path}: line {number} has no videos; name one, or one a view")
        name = _free(_name(path, number, given, values), {*clips, *reserved})
        clips[name] = ListedClip(name, values)
        if len(clips) > _MOST:
            raise InputError(f"{path}: lists more than {_MOST} clips; split it")
    if not clips:
        raise InputError(f"{path}: lists no clips; expected a line for each below its first line")
    return tuple(clips.values())


def _check_header(path: Path, header: list[str], known: tuple[str, ...], what: str) -> None:
    if "videos" not in header and "videos" in re.split(r"[;\t]", ",".join(header)):
        raise InputError(
            f"{path}: its cells are apart by semicolons or tabs; expected commas: save it again as "
            "CSV with commas"
        )
    if "videos" not in header:
        raise InputError(f"{path}: its first line names no column videos; expected {what}")
    for column in header:
        if column not in known:
            near = difflib.get_close_matches(column[:100], known, 1)
            hint = f"did you mean {near[0]}?" if near else f"expected some of {', '.join(known)}"
            raise InputError(f"{path}: {column!r:.60} is no column; {hint}")
    if len(set(header)) < len(header):
        raise InputError(f"{path}: its first line names a column twice")


def _parts(path: Path, number: int, key: str, cell: str) -> tuple[str, ...]:
    parts = tuple(part.strip() for part in cell.split(";") if part.strip())
    for part in parts:
        if part.startswith("-") and not _NUMBER.fullmatch(part):
            raise InputError(
                f"{path}: line {number}: {key} is {part!r:.60}; options have columns of their own"
            )
        if not part.isprintable():
            raise InputError(f"{path}: line {number}: {key} holds letters that cannot be printed")
    return parts


def _beside(path: Path, part: str, always: bool) -> str:
    """A path as it is from here; names of shipped models stay where no file is called so."""
    try:
        there = path.parent / part
        return str(there) if always or there.exists() else part
    except (OSError, ValueError):
        return part


def _name(
    path: Path, number: int, given: Mapping[str, str], values: Mapping[str, tuple[str, ...]]
) -> str:
    stated = given.get(_NAME, "").strip()
    if not stated:
        stem = Path(values["videos"][0]).stem
        return re.sub(r"[^\w .()-]", "_", stem).strip(" .")[:40] or "clip"
    plain = re.fullmatch(r"[\w][\w .()&+,'-]*", stated) is not None
    if not plain or stated.endswith(".") or len(stated.encode()) > _LONGEST:
        raise InputError(
            f"{path}: line {number}: {stated!r:.60} cannot be the name of a folder; use letters, "
            "digits, blanks, dots and dashes"
        )
    return stated


def _free(name: str, taken: Collection[str]) -> str:
    lowered = {each.lower() for each in taken}  # file systems that do not tell case apart
    number, free = 2, name
    while free.lower() in lowered:
        free, number = f"{name}_{number}", number + 1
    return free
