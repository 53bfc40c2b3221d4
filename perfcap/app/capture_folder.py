"""The folder of a capture, one or several people's: what may be written over, and what not."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from stat import S_ISDIR, S_ISREG

from perfcap.errors import InputError
from perfcap.io.files import read_json
from perfcap.io.mask_files import holds_masks
from perfcap.io.result_folder import (
    ABOUT,
    DETECTIONS,
    FILES,
    MASKS,
    METRICS,
    OWN,
    PAGE,
    PEOPLE,
    PERSON,
    REPORT,
    SURFACE,
    WORK,
    holds_result,
    is_several,
    own_file,
    people_of,
    person_folder,
)

_SHARED = ("input_files", "retargeted_from", "frames", "fps")  # of all people of a capture
_PERSONAL = ("actor", "detections", "detections_in", "out")  # of the calls that they state
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
    for path in inputs:
        for name in (*_written(detected), MASKS):
            if same_file(path, folder / name):
                raise InputError(
                    f"--out {folder}: {name} of the result would replace the input {path}; choose "
                    "another folder"
                )


def spare_others(folder: Path, overwrite: bool, detected: bool) -> None:
    """Refuse a folder whose files have the names of a result's and are of no result.

    Args:
        folder: of the results, after ``finish``.
        overwrite: whether these may be replaced.
        detected: whether ``detections.npz`` is written too.

    Raises:
        InputError: the user's own files would be replaced or removed.
    """
    if overwrite or holds_result(folder) or (folder / WORK).exists():
        return
    names = [name for name in _written(detected) if name not in (METRICS, PAGE)]
    found = [name for name in names if (folder / name).exists()]
    people = [place for place in sorted(folder.iterdir()) if PERSON.fullmatch(place.name)]
    found += [f"{p.name}/{name}" for p in people for name in FILES if (p / name).exists()]
    found += [f"{MASKS}/"] if holds_masks(folder / MASKS) else []
    if found:
        raise InputError(
            f"--out {folder}: holds {', '.join(found)} but no result; choose another folder, or "
            "add --overwrite if they may be replaced or removed"
        )


def spare_result(folder: Path, target: Path, own: str = "") -> None:
    """Refuse a file that would take the place of a result, or of what it was captured from.

    Args:
        folder: of the result.
        target: about to be written.
        own: the name in the folder that it may have.

    Raises:
        InputError: says what it would replace.
    """
    places = [folder / name for name in OWN if name != own]
    try:
        report = read_json(folder / REPORT, "the report of a capture")
    except InputError:  # a result is its motion
        report = {}
    inputs = report.get("input_files") if isinstance(report, dict) else None
    places += [Path(name) for name in inputs] if isinstance(inputs, dict) else []
    beside = target.parent
    if target.name in OWN and not same_file(beside, folder) and holds_result(beside):
        raise InputError(
            f"--out {target}: is a file of another result, {beside}; choose another name"
        )
    for place in places:
        if same_file(target, place):
            raise InputError(
                f"--out {target}: is {place}, which the result {folder} consists of or was "
                "captured from; choose another name"
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


def _written(detected: bool) -> tuple[str, ...]:
    """Names of files of a result."""
    return (*FILES, SURFACE, *ABOUT, *((DETECTIONS,) if detected else ()))


def same_file(path: Path, other: Path) -> bool:
    """Whether two paths are of one file or folder that is there."""
    try:
        return path.samefile(other)
    except OSError:  # one of them is not there
        return False


# --- Commands on a finished capture, for each person of it ----------------------------------------


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
    """Folders of people, and their names; the folder itself and no name where there is one.

    Raises:
        InputError: the list of people is damaged, or the folder of one is of another capture.
    """
    several, places = is_several(folder), people_of(folder)
    if several:
        _require_same_capture(folder, places)
    for place in places:
        yield place, place.name if several else ""


def _require_same_capture(folder: Path, places: Iterable[Path]) -> None:
    """Refuse a person who was captured from other inputs or by another call than all, or twice."""
    common = _report(folder)
    people: dict[object, Path] = {}
    for place in places:
        report = _report(place)
        own = _origin(report)
        for key, value in _origin(common).items():
            if own.get(key, value) != value:
                raise InputError(
                    f"{place}: is of another capture than {folder} (its {key} is another, see both "
                    f"{REPORT}); put the person's own folder back, or run perfcap capture again"
                )
        number = report.get("person", place.name)
        if number in people:
            raise InputError(
                f"{place}: is person {number} of the capture, as is {people[number]}; put the "
                "person's own folder back, or run perfcap capture again"
            )
        if isinstance(number, int) and place.name != person_folder(number):
            raise InputError(
                f"{place}: is person {number} of the capture; call its folder "
                f"{person_folder(number)} again, {folder / PEOPLE} names who is who"
            )
        people[number] = place


def _report(folder: Path) -> dict[str, object]:
    path = own_file(folder, REPORT)
    report = None if path is None else read_json(path, "the report of a capture")
    return report if isinstance(report, dict) else {}


def _origin(report: Mapping[str, object]) -> dict[str, object]:
    """From what, and by which call, a result is, as far as its report says it."""
    request = report.get("request")
    call = request.items() if isinstance(request, dict) else ()
    found = {key: report[key] for key in _SHARED if key in report}
    return found | {f"--{key}": value for key, value in call if key not in _PERSONAL}


def beside(path: Path, person: str) -> Path:
    """A file of a person, where all of theirs go to one place: the name is added to the file's."""
    return path if not person else path.with_name(f"{path.stem}_{person}{path.suffix}")
