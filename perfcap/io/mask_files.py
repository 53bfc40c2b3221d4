"""Silhouettes as folders of numbered PNG files, one a frame."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.atomic import unwritable, writing

_FILE = re.compile(r"\d{6,}\.png")
_PLAIN = re.compile(r"\w[\w .-]{0,99}")  # names of views that can be names of folders
_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def save_masks(folder: Path, views: Mapping[str, Iterable[bytes]], start: int = 0) -> int:
    """Write encoded masks as ``000000.png`` ..., each complete or not at all.

    One view lies in the folder itself, several in folders of their names. Masks that an older run
    left behind are removed first; other files are left alone.

    Args:
        folder: made if missing.
        views: one encoded PNG a frame, by the view's name: 0 background, k person.
        start: number of the first frame.

    Returns:
        Number of files.

    Raises:
        InputError: the folder cannot be written, or an image is no PNG.
    """
    if folder.is_symlink():
        raise _elsewhere(folder)
    remove_masks(folder)
    return sum(
        _save_view(folder / name, images, start)
        for name, images in zip(view_folders(list(views)), views.values(), strict=True)
    )


def view_folders(views: list[str]) -> list[str]:
    """Folder of each view below ``masks``: its name, or its number where that is no plain name."""
    if len(views) == 1:
        return ["."]
    return [n if _PLAIN.fullmatch(n) else f"view_{i}" for i, n in enumerate(views)]


def holds_masks(folder: Path) -> bool:
    """Whether there are files that ``remove_masks`` would remove; not behind a link."""
    if folder.is_symlink() or not folder.is_dir():
        return False
    inner = [entry for entry in folder.iterdir() if entry.is_dir() and not entry.is_symlink()]
    found = (entry for place in (folder, *inner) for entry in place.iterdir())
    return any(_FILE.fullmatch(entry.name) and not entry.is_dir() for entry in found)


def remove_masks(folder: Path, kept: Collection[str] = ()) -> None:
    """Remove masks from a folder and from the folders in it, then those of them that are empty.

    Files of other names stay, and links to other folders are not followed: not even ``folder``.

    Args:
        folder: with masks, or folders of them.
        kept: masks that stay, relative to ``folder``.

    Raises:
        InputError: a file cannot be removed.
    """
    if folder.is_symlink():
        return
    try:
        inner = [entry for entry in folder.iterdir() if entry.is_dir() and not entry.is_symlink()]
        for place in (*inner, folder):
            for entry in list(place.iterdir()):
                is_mask = _FILE.fullmatch(entry.name) and not entry.is_dir()
                if is_mask and entry.relative_to(folder).as_posix() not in kept:
                    entry.unlink()
            with suppress(OSError):  # holds something else
                place.rmdir()
    except FileNotFoundError:
        return
    except OSError as error:
        raise unwritable(folder, error) from error


def _save_view(folder: Path, images: Iterable[bytes], start: int) -> int:
    if folder.is_symlink():
        raise _elsewhere(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error
    number = start
    for number, data in enumerate(images, start + 1):
        if not data.startswith(_SIGNATURE):
            raise InputError(f"{folder}: mask of frame {number - 1} is not an encoded PNG")
        with writing(folder / f"{number - 1:06d}.png") as file:
            file.write(data)
    return number - start


def _elsewhere(folder: Path) -> InputError:
    return InputError(f"{folder}: is a link to another folder, where nothing is written; remove it")
