"""Commands on a finished capture, for each person of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from perfcap.io.result_folder import is_several, people_of


def for_everybody(folder: Path, command: Callable[[Path, str], int]) -> int:
    """Run a command on the folder of each person; the first exit code that is not zero.

    Args:
        folder: of a capture, of one person or several.
        command: of a folder, and the name of the person in it: empty where there is one alone.

    Raises:
        InputError: the people are not listed as they should be, or the command does.
    """
    codes = [command(place, name) for place, name in named_people(folder)]
    return next((code for code in codes if code), 0)


def named_people(folder: Path) -> Iterator[tuple[Path, str]]:
    """Folders of people, and their names; the folder itself and no name where there is one."""
    for place in people_of(folder):
        yield place, place.name if is_several(folder) else ""


def beside(path: Path, person: str) -> Path:
    """A file of a person, where all of theirs go to one place: the name is added to the file's."""
    return path if not person else path.with_name(f"{path.stem}_{person}{path.suffix}")
