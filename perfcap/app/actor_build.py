"""``perfcap actor build``: an actor folder from what a user has."""

from __future__ import annotations

import logging
from dataclasses import fields, replace
from pathlib import Path

from perfcap.actor.actor import Actor
from perfcap.actor.measurements import Measurements
from perfcap.app.actor_inspect import run_inspect
from perfcap.app.actor_make import (
    CHARACTERS,
    GENDERS,
    Rigging,
    body_of,
    is_bare,
    require_no_source,
    rigged_mesh,
)
from perfcap.app.actor_sheet import SHEET
from perfcap.app.capture_folder import same_file
from perfcap.app.console import PlainConsole
from perfcap.app.measures import save_measures
from perfcap.commands.actor import ActorBuild
from perfcap.errors import InputError
from perfcap.io.actor_folder import MANIFEST, MESH, UNKNOWN, save_actor
from perfcap.io.actor_import import import_actor, require_sound
from perfcap.io.actor_mapping import read_mapping
from perfcap.io.doctor import Severity
from perfcap.io.gltf_document import require_readable_kind
from perfcap.io.mesh import FORMATS
from perfcap.pipeline.appearance import Appearance
from perfcap.rigging import Person

# what the command asks about a person
_MEASURES = tuple(f.name for f in fields(Person) if f.name in {o.name for o in fields(ActorBuild)})

_LOG = logging.getLogger(__name__)


def _person(request: ActorBuild) -> Person:
    """Who is asked for.

    Raises:
        InputError: a measure that no person has.
    """
    values = {name: getattr(request, name) for name in _MEASURES}
    gender = values.pop("gender")
    return Person(**values, gender=None if gender is None else GENDERS[gender])


def run_build(request: ActorBuild) -> int:
    """Write the folder and show what is in it; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    _spare_inputs(request)
    actor, licence, provenance, measurements = _made(request, _person(request))
    if request.name is not None:
        actor = Actor(replace(actor.template, name=request.name), actor.skeleton.rig)
    Appearance.of(actor.template)  # whether the texture can be decoded, before anything is written
    save_actor(actor, request.out, licence=request.licence or licence, provenance=provenance)
    if measurements is not None:
        save_measures(request.out, measurements, None, provenance)
    code = run_inspect(str(request.out), None, request.out)
    PlainConsole().print(f"capture with --actor {request.out}", soft_wrap=True)
    return code


def _spare_inputs(request: ActorBuild) -> None:
    for path in (request.source, request.mapping, request.overrides):
        for name in (MESH, MANIFEST, SHEET):
            if path is not None and same_file(path, request.out / name):
                raise InputError(
                    f"--out {request.out}: {name} of the actor would replace the input {path}; "
                    "choose another folder"
                )


def _made(request: ActorBuild, person: Person) -> tuple[Actor, str, str, Measurements | None]:
    """The actor, its licence, where it comes from, and what the body in it measures if known."""
    if request.out.exists() and not request.out.is_dir():
        raise InputError(f"--out {request.out}: is a file; expected a folder for {MANIFEST}")
    if request.body:
        require_no_source(request.source)
        _refuse_others(request, "--body", _MEASURES)
        actor, licence, measured = body_of(person, request.body_model, request.name)
        return actor, licence, f"body model {request.body_model}", measured
    if request.source is None:
        raise InputError("no file is given; expected a character or a mesh, or --body")
    require_readable_kind(request.source)
    kinds = tuple(dict.fromkeys((*CHARACTERS, *FORMATS)))
    if request.source.suffix.lower() not in kinds:
        raise InputError(
            f"{request.source}: is {request.source.suffix or 'without a suffix'}; expected a "
            f"rigged character or a bare mesh: {', '.join(kinds)}"
        )
    if is_bare(request.source):
        _refuse_others(request, "a mesh without bones", ("height", "overrides", "detector"))
        how = Rigging(request.body_model, person.height, request.overrides, request.detector)
        actor, inside = rigged_mesh(request.source, how)
        return actor, UNKNOWN, f"rigged automatically from {request.source.name}", inside
    _refuse_others(request, "a character with bones", ("mapping",))
    return (*_from_rigged(request, request.source), None)


def _refuse_others(request: ActorBuild, kind: str, used: tuple[str, ...]) -> None:
    """Refuse options that would do nothing."""
    options = {name: getattr(request, name) for name in ("mapping", "overrides", "detector")}
    options |= {name: getattr(request, name) for name in _MEASURES}
    for name, value in options.items():
        if value is not None and name not in used:
            raise InputError(f"--{name}: does nothing for {kind}; leave it out")


def _from_rigged(request: ActorBuild, source: Path) -> tuple[Actor, str, str]:
    mapping = None if request.mapping is None else read_mapping(request.mapping)
    imported = import_actor(source, mapping)
    require_sound(source, imported.findings)
    for finding in imported.about_file:  # the folder no longer tells what was put right
        if finding.severity is Severity.WARNING:
            _LOG.warning("%s: %s", source, finding)
    rights = imported.character.copyright or UNKNOWN
    return imported.actor, rights, f"imported from {source.name}"
