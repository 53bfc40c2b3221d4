"""The folder of several captured people: who they are, each in a folder of their own."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.files import MEBIBYTE, read_json
from perfcap.io.result_folder import PEOPLE, PERSON, own_file

_LIMIT = MEBIBYTE


def person_folder(number: int) -> str:
    """Name of the folder of a person, who are counted from 1."""
    return f"person{number}"


def write_people(folder: Path, people: Sequence[dict[str, Any]]) -> None:
    """Write who they are: the folder of each is added."""
    listed = [{"folder": person_folder(k), **about} for k, about in enumerate(people, 1)]
    with writing(folder / PEOPLE) as file:
        file.write((json.dumps({"K": len(listed), "people": listed}, indent=1) + "\n").encode())


def people_of(folder: Path) -> tuple[Path, ...]:
    """Folders of the people of a result; the folder itself where it is of one person.

    Raises:
        InputError: the list of people is damaged.
    """
    path = own_file(folder, PEOPLE)
    if path is None:
        return (folder,)
    values = read_json(path, "the people of a capture", _LIMIT)
    listed = values.get("people") if isinstance(values, dict) else None
    entries = listed if isinstance(listed, list) else []
    names = [each.get("folder") if isinstance(each, dict) else None for each in entries]
    if not names or not all(isinstance(n, str) and PERSON.fullmatch(n) for n in names):
        raise InputError(f"{path}: names no folders of people; run perfcap capture again")
    places = tuple(folder / str(name) for name in names)
    for place in places:
        if place.is_symlink() or not place.is_dir():
            raise InputError(f"{place}: is no folder of a person; run perfcap capture again")
    return places


def is_several(folder: Path) -> bool:
    """Whether a result is of several people."""
    return own_file(folder, PEOPLE) is not None
