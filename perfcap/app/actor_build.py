"""``perfcap actor build``: an actor folder from what a user has."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from perfcap.actor.actor import Actor
from perfcap.app.actor_inspect import run_inspect
from perfcap.errors import InputError
from perfcap.io.actor_folder import MANIFEST, UNKNOWN, save_actor
from perfcap.io.actor_import import import_actor, require_sound
from perfcap.io.actor_mapping import read_mapping
from perfcap.pipeline.appearance import Appearance

_RIGGED = (".glb", ".gltf", ".vrm")


@dataclass(frozen=True)
class BuildRequest:
    """What the command line asks for; see ``perfcap actor build --help``."""

    source: Path
    out: Path
    mapping: Path | None = None
    name: str | None = None
    licence: str | None = None


def run_build(request: BuildRequest) -> int:
    """Write the folder and show what is in it; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    actor, licence, provenance = _made(request)
    if request.name is not None:
        actor = Actor(replace(actor.template, name=request.name), actor.skeleton.rig)
    Appearance.of(actor.template)  # whether the texture can be decoded, before anything is written
    save_actor(actor, request.out, licence=request.licence or licence, provenance=provenance)
    code = run_inspect(str(request.out), None, request.out)
    Console().print(f"capture with --actor {request.out}", soft_wrap=True, markup=False)
    return code


def _made(request: BuildRequest) -> tuple[Actor, str, str]:
    """The actor, its licence and where it comes from."""
    suffix = request.source.suffix.lower()
    if suffix in _RIGGED:
        return _from_rigged(request)
    raise InputError(
        f"{request.source}: is {suffix or 'without a suffix'}; expected a rigged character, "
        f"{', '.join(_RIGGED)}"
    )


def _from_rigged(request: BuildRequest) -> tuple[Actor, str, str]:
    if request.out.exists() and not request.out.is_dir():
        raise InputError(f"--out {request.out}: is a file; expected a folder for {MANIFEST}")
    mapping = None if request.mapping is None else read_mapping(request.mapping)
    imported = import_actor(request.source, mapping)
    require_sound(request.source, imported.findings)
    rights = imported.character.copyright or UNKNOWN
    return imported.actor, rights, f"imported from {request.source.name}"
