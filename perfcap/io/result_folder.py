"""The folder of a result, of one person or several: one writer at a time, whole results only."""

from __future__ import annotations

import fcntl
import json
import logging
import os
import re
import shutil
import stat
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from perfcap.errors import InputError
from perfcap.io.atomic import settle, unwritable, writing
from perfcap.io.earlier_files import tell_of_exports, tell_of_others, written_at
from perfcap.io.files import MEBIBYTE, read_json
from perfcap.io.mask_files import remove_masks

REPORT, MOTION, SURFACE, MASKS = "run.json", "motion.npz", "surface.npz", "masks"
FILES = (MOTION, "motion.bvh", "capture.glb", "config.yaml", REPORT)
OVERLAY, TEXTURED, DETECTIONS = "overlay.mp4", "textured.mp4", "detections.npz"
METRICS, PAGE = "metrics.json", "report.html"
ASSUMED_CAMERA = "assumed_camera.json"
BODY, MEASURES, BODY_PICTURE = "body.npz", "measurements.json", "body.jpg"
PERSONAL = (BODY, MEASURES, BODY_PICTURE)  # of a body that was fitted to the person
PEOPLE, SCENE = "people.json", "scene.glb"  # of several people, who have folders of their own
VOLUME = "volume.npz"
EXPORT = "export"  # folder of files for other programs
_PICTURES = (OVERLAY, TEXTURED, METRICS, PAGE)
ABOUT = (*_PICTURES, ASSUMED_CAMERA, VOLUME, *PERSONAL, PEOPLE, SCENE)  # tell of one result
OWN = (*FILES, SURFACE, DETECTIONS, *ABOUT)

WORK = ".perfcap"  # where a result grows; gone once it is complete
_NEXT, _PLAN = "next", "publish.json"
PERSON = re.compile(r"person[1-9]\d{0,3}")
_MASK = re.compile(rf"{MASKS}/(?:\w[\w .-]{{0,99}}/)?\d{{6,}}\.png")

_LOG = logging.getLogger(__name__)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Be the only one who writes a result into a folder; the lock ends with the process.

    Raises:
        InputError: somebody else is writing there.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{folder}: another perfcap writes into this folder at the moment; wait for "
                "it, or choose another folder"
            ) from None
        except OSError as error:
            _LOG.warning("%s: cannot be locked (%s); let no other run write there", folder, error)
        yield
    finally:
        os.close(descriptor)


def require_places(folder: Path, views: Collection[str] = ()) -> None:
    """Refuse a folder in which something else lies where a result has its files.

    Links to folders are something else: what is written or removed behind one is elsewhere.

    Args:
        folder: of the result.
        views: folders of masks that will be written below ``masks``.

    Raises:
        InputError: names what is in the way.
    """
    for name in OWN:
        if _kind(folder / name) == stat.S_IFDIR:
            raise InputError(f"{folder / name}: is a folder, expected a file or nothing; remove it")
    places = (folder / WORK, folder / MASKS, *(folder / MASKS / view for view in views))
    for place in places:
        if _kind(place) not in (None, stat.S_IFDIR):
            raise InputError(
                f"{place}: is a link or a file, expected a folder or nothing; remove it, nothing "
                "outside the folder of a result is written or removed"
            )


def own_file(folder: Path, name: str) -> Path | None:
    """A regular file of a result; None where it is missing, behind a link, a folder or a pipe."""
    place = folder
    for part in Path(name).parent.parts:
        place = place / part
        if _kind(place) != stat.S_IFDIR:
            return None
    return folder / name if _kind(folder / name) == stat.S_IFREG else None


def holds_result(folder: Path) -> bool:
    """Whether anything lies where a result has its report or its motion."""
    return any(_kind(folder / name) is not None for name in (REPORT, MOTION))


@contextmanager
def replacing(folder: Path, *, last: bool = False) -> Iterator[Path]:
    """A scratch folder whose files become the result in ``folder`` when the block ends well.

    An older result stays as it is until then. What tells of it and is not replaced is removed;
    ``detections.npz`` tells of the video and stays. The caller holds the lock.

    Args:
        folder: of the result.
        last: whether checkpoints lie there that are not needed any more afterwards.

    Raises:
        InputError: the place cannot be written, or something else is in the way.
    """
    require_places(folder)
    scratch = folder / WORK / _NEXT
    try:
        _remove(scratch)
        scratch.mkdir(parents=True)
        yield scratch
        _require_all(folder, _files(scratch))
        _plan(folder, scratch, last)
        finish(folder)
    except OSError as error:
        raise unwritable(folder, error) from error
    except InputError as error:
        # users know the folder that they named, not where files grow
        raise InputError(str(error).replace(str(scratch), str(folder))) from error
    finally:
        if not is_between(folder):
            tidy(folder)


def is_between(folder: Path) -> bool:
    """Whether a complete result is only partly in its place: ``finish`` was interrupted."""
    return own_file(folder / WORK, _PLAN) is not None


def finish(folder: Path) -> None:
    """Put a complete result into its place; also where somebody was killed while doing so.

    Raises:
        InputError: something is in the way.
    """
    if not is_between(folder):
        return
    plan = _Plan.read(folder / WORK / _PLAN)
    scratch = folder / WORK / _NEXT
    _require_all(folder, plan.names)
    for name in plan.names:
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
    since = written_at(folder / REPORT)
    if own_file(scratch, REPORT) is not None:
        (folder / REPORT).unlink(missing_ok=True)  # no report vouches for files of two results
    _move(scratch, folder, [name for name in plan.names if name != REPORT])
    _remove_older(folder, plan)
    if plan.older:
        for place in (folder / EXPORT, *sorted(folder.glob(f"person*/{EXPORT}"))):
            tell_of_exports(place)
        own = {name.split("/")[0] for name in plan.names} | {REPORT, MASKS, EXPORT}
        tell_of_others(folder, own, since)
    _move(scratch, folder, [REPORT])
    settle(folder)
    # the plan goes last: without it, half-removed checkpoints would be those of another call
    for entry in (folder / WORK).iterdir() if plan.last else ():
        if entry.name != _PLAN:
            _remove(entry)
    _remove(folder / WORK / _PLAN)
    tidy(folder, everything=plan.last)


def tidy(folder: Path, *, everything: bool = False) -> None:
    """Remove scratch files, and the work folder where nothing else, or ``everything``, is in it."""
    work = folder / WORK
    if _kind(work) != stat.S_IFDIR:
        return
    with suppress(OSError):
        _remove(work if everything else work / _NEXT)
    with suppress(OSError):  # checkpoints are in it
        work.rmdir()


@dataclass(frozen=True)
class _Plan:
    """What is to be put into place.

    Attributes:
        names: files, relative to the folder.
        older: whether an older result was there.
        last: whether nothing in the work folder is needed afterwards.
    """

    names: tuple[str, ...]
    older: bool
    last: bool

    @classmethod
    def read(cls, path: Path) -> _Plan:
        values = read_json(path, "what a capture was about to put into place")
        names = values.get("names") if isinstance(values, dict) else None
        if not isinstance(names, list) or not all(isinstance(n, str) and _is_own(n) for n in names):
            raise InputError(f"{path}: is damaged; remove the folder {path.parent}")
        return cls(tuple(names), values.get("older") is True, values.get("last") is True)


def _is_own(name: str) -> bool:
    name = _of_person(name)[1]
    return name in OWN or _MASK.fullmatch(name) is not None


def _of_person(name: str) -> tuple[str, str]:
    """The folder of a person whose file it is, "" where it is nobody's own, and its name there."""
    folder, slash, rest = name.partition("/")
    return (folder, rest) if slash and PERSON.fullmatch(folder) else ("", name)


def _require_all(folder: Path, names: Collection[str]) -> None:
    """``require_places`` of a result, and of the people in it."""
    by_person: dict[str, set[str]] = {"": set()}
    for person, name in map(_of_person, names):
        views = by_person.setdefault(person, set())
        if _MASK.match(name):
            views.add(Path(name).parent.name)
    for person, views in by_person.items():
        if _kind(folder / person) not in (None, stat.S_IFDIR):
            raise InputError(
                f"{folder / person}: is a link or a file, expected a folder; remove it"
            )
        require_places(folder / person, views)


def _files(scratch: Path) -> list[str]:
    found = (path for path in sorted(scratch.rglob("*")) if not path.is_dir())
    return [path.relative_to(scratch).as_posix() for path in found]


def _plan(folder: Path, scratch: Path, last: bool) -> None:
    names = _files(scratch)
    unknown = [name for name in names if not _is_own(name)]
    assert not unknown, unknown
    older = holds_result(folder)
    with writing(folder / WORK / _PLAN) as file:
        file.write(json.dumps({"names": names, "older": older, "last": last}).encode())
    for place in (scratch, folder / WORK):
        settle(place)  # no loss of power brings the plan without what it speaks of


def _move(scratch: Path, folder: Path, names: Collection[str]) -> None:
    """Files that are still in the scratch folder."""
    for name in names:
        if own_file(scratch, name) is not None:
            os.replace(scratch / name, folder / name)


def _remove_older(folder: Path, plan: _Plan) -> None:
    """What tells of an older result and is not part of the new one."""
    several = PEOPLE in plan.names
    gone = (*ABOUT, SURFACE, *(FILES if several else ())) if plan.older else (SURFACE,)
    _remove_from(folder, gone, plan.names)
    for place in sorted(folder.iterdir()) if plan.older else ():
        if PERSON.fullmatch(place.name) and _kind(place) == stat.S_IFDIR:
            own = [name for person, name in map(_of_person, plan.names) if person == place.name]
            _remove_from(place, OWN, own)
            with suppress(OSError):  # something else is in it
                place.rmdir()


def _remove_from(folder: Path, gone: Collection[str], kept: Collection[str]) -> None:
    for name in gone:
        if name not in kept:
            (folder / name).unlink(missing_ok=True)
    remove_masks(folder / MASKS, {n.removeprefix(f"{MASKS}/") for n in kept})


def _remove(path: Path) -> None:
    """A file, a link or a folder with all that is in it; links in it are not followed."""
    if _kind(path) == stat.S_IFDIR:
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _kind(path: Path) -> int | None:
    """What lies at a path, links not followed; None where nothing does."""
    try:
        return stat.S_IFMT(path.lstat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return None


# --- The folder of several captured people: who they are, each in a folder of their own -----------

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
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{path}: names {twice} twice, expected a folder for each person")
    places = tuple(folder / str(name) for name in names)
    for place in places:
        if place.is_symlink() or not place.is_dir():
            raise InputError(f"{place}: is no folder of a person; run perfcap capture again")
    return places


def is_several(folder: Path) -> bool:
    """Whether a result is of several people."""
    return own_file(folder, PEOPLE) is not None
