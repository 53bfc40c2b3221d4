"""Actors by name or by file."""

from __future__ import annotations

import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

from perfcap.actor.actor import Actor
from perfcap.errors import InputError
from perfcap.io.files import read_text
from perfcap.io.gltf import load_template

_FILE, _MANIFEST = "actor.glb", "manifest.toml"


@dataclass(frozen=True)
class ActorFile:
    """Where an actor is, and whether it stands for anybody rather than for one person."""

    path: Path
    generic: bool


def models_folder() -> Path:
    """The folder of shipped models: beside the package in a checkout, else where it is installed.

    Raises:
        InputError: neither is there.
    """
    places = (
        Path(__file__).resolve().parents[2] / "models",
        Path(sys.prefix) / "share" / "perfcap" / "models",
    )
    for place in places:
        if (place / "actors").is_dir():
            return place
    raise InputError(f"{places[0]}: the models folder is missing; install perfcap again")


def find_actor(name: str | Path) -> ActorFile:
    """A shipped actor by name, a ``.glb``/``.gltf`` file, or a folder that holds ``actor.glb``.

    Raises:
        InputError: there is no such actor.
    """
    path = Path(name)
    if path.is_file():
        return ActorFile(path, generic=False)
    folder = path if path.is_dir() else models_folder() / "actors" / path.name
    if not (folder / _FILE).is_file():
        known = sorted(p.parent.name for p in (models_folder() / "actors").glob(f"*/{_FILE}"))
        raise InputError(
            f"--actor {name}: no such file, and no shipped actor has that name; expected a skinned "
            f".glb, a folder with {_FILE}, or one of {', '.join(known)}"
        )
    return ActorFile(folder / _FILE, _is_generic(folder / _MANIFEST))


def load_actor(name: str | Path) -> Actor:
    """The actor of a name or file (see ``find_actor``), in float64.

    Raises:
        InputError: it cannot be read, has no skin, or lacks bones of the skeleton.
    """
    return Actor(load_template(find_actor(name).path))


def _is_generic(manifest: Path) -> bool:
    if not manifest.is_file():
        return False
    try:
        return bool(tomllib.loads(read_text(manifest, "manifest")).get("generic", False))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{manifest}: is not TOML ({error}); restore it") from None
