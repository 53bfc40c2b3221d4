"""Where an actor's folder is written: what perfcap puts there, and what of it may be replaced."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, read_toml
from perfcap.io.publish import WORK
from perfcap.io.result_folder import BODY, MEASURES, holds_result

MESH, MANIFEST = "actor.glb", "manifest.toml"
SHEET, FIT_SHEET = "contact_sheet.jpg", "fit.jpg"
BESIDE = (SHEET, MEASURES, BODY, FIT_SHEET)  # tell of one actor; not all commands write them all
WHAT = "the manifest of an actor"


def is_built(folder: Path) -> bool:
    """Whether a folder holds an actor that perfcap wrote.

    Raises:
        InputError: its manifest cannot be read.
    """
    manifest = folder / MANIFEST
    return manifest.is_file() and "name" in read_toml(manifest, WHAT, MEBIBYTE)


def spare_files(folder: Path, beside: Iterable[str] = BESIDE) -> None:
    """Refuse to replace or remove files that have the names of an actor's and are of no actor.

    Args:
        folder: that an actor is to be written into.
        beside: names of the files that are written, or removed, besides mesh and manifest.

    Raises:
        InputError: there are such, and no manifest of an actor that perfcap wrote.
    """
    if is_built(folder) or (folder / WORK).exists():  # of a call that was killed
        return
    found = [name for name in (MESH, MANIFEST, *beside) if (folder / name).exists()]
    if found:
        raise InputError(
            f"--out {folder}: holds {', '.join(found)} but no actor that perfcap has built; choose "
            "another folder, or delete what may be replaced"
        )


def of_earlier(folder: Path) -> tuple[str, ...]:
    """Names of the files that tell of the actor in a folder, and of no other one's.

    None where no actor that perfcap wrote is there: such files are the user's own. Where there is a
    capture as well, its body and measurements have these names.
    """
    try:
        if not is_built(folder):
            return ()
    except InputError:  # it is replaced, by whoever may
        return ()
    captured = (BODY, MEASURES) if holds_result(folder) else ()
    return tuple(name for name in BESIDE if name not in captured)
