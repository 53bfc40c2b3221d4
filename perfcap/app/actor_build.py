"""``perfcap actor build``: an actor folder from what a user has."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path

from perfcap.actor.actor import Actor
from perfcap.actor.measurements import Measurements
from perfcap.app.actor_inspect import run_inspect
from perfcap.app.capture_folder import same_file
from perfcap.app.console import PlainConsole
from perfcap.app.measures import print_measures, save_measures
from perfcap.app.networks import DETECTORS, find_model
from perfcap.commands.actor import ActorBuild
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.onnx import OnnxDetector
from perfcap.errors import InputError
from perfcap.io.actor_check import examine_actor
from perfcap.io.actor_folder import UNKNOWN, save_actor, spare_actor
from perfcap.io.actor_import import import_actor, read_mapping, require_sound
from perfcap.io.actor_place import BESIDE, MANIFEST, MESH, spare_files
from perfcap.io.body_model import load_body_model
from perfcap.io.doctor import Severity
from perfcap.io.gltf_document import open_document, require_readable_kind
from perfcap.io.mesh import FORMATS, read_mesh
from perfcap.io.result_folder import BODY
from perfcap.pipeline.appearance import Appearance
from perfcap.rigging import Person, RigReport, build_body, read_overrides
from perfcap.rigging.auto_rig import rig_bare_mesh

# --- Actors for those who have no rig: of a bare mesh, or of nothing but a person's measures ------

CHARACTERS = (".glb", ".gltf", ".vrm")
GENDERS = {"male": 0.0, "female": 1.0}

_LOG = logging.getLogger(__name__)


def is_bare(source: Path) -> bool:
    """Whether a file holds a mesh without bones."""
    suffix = source.suffix.lower()
    if suffix not in CHARACTERS:
        return suffix in FORMATS
    return not open_document(source).items("skins")


@dataclass(frozen=True)
class Rigging:
    """How a bare mesh is rigged.

    Attributes:
        body: name or file of the body model.
        height: of the person, metres.
        overrides: file of regions that only some bones may move.
        detector: folder or name of a joint detector that looks at the mesh.
    """

    body: str
    height: float | None = None
    overrides: Path | None = None
    detector: str | None = None


def rigged_mesh(source: Path, how: Rigging) -> tuple[Actor, Measurements | None]:
    """A mesh with a skeleton and weights of its own, and what the body in it measures.

    Raises:
        InputError: it cannot be read, or is not of one person in a T- or A-pose.
    """
    rules = () if how.overrides is None else read_overrides(how.overrides)
    mesh = read_mesh(source)
    if how.height is not None:
        Person(height=how.height)  # refuses what no person is
    detector = None if how.detector is None else _detector(how.detector)
    template, report = rig_bare_mesh(
        mesh, load_body_model(how.body), how.height, rules, detector=detector
    )
    _print_rig(report)
    require_sound(source, report.about_actor)
    return Actor(template.rounded()), report.measurements


def body_of(person: Person, body: str, name: str | None) -> tuple[Actor, str, Measurements]:
    """A body with what is known of a person, its licence, and what it measures."""
    model = load_body_model(body)
    built = build_body(model, person)
    print_measures(built.measurements, weight=built.weight)
    template = replace(built.template, name=name or model.rig.name).rounded()
    require_sound(Path(body), examine_actor(template))
    return Actor(template), model.rig.licence, built.measurements


def require_no_source(source: Path | None) -> None:
    """Refuse a file beside ``--body``."""
    if source is not None:
        raise InputError(
            f"--body makes a person of measures alone, but {source} was given; leave one of them"
        )


def _detector(name: str) -> OnnxDetector:
    detector = OnnxDetector(find_model(name, DETECTORS))
    for line in detector.warnings:
        _LOG.warning("%s", line)
    return detector


def _print_rig(report: RigReport) -> None:
    console = PlainConsole()
    upright, fit = report.upright, report.fit
    if upright is not None and fit is not None:
        console.print(
            f"taken to be in {upright.unit}, scaled by {upright.scale:g}; a body fits within "
            f"{1e3 * fit.distance:.0f} mm (median)"
        )
    if report.seen is not None:
        found, (views, shown) = report.seen.found, report.seen.views
        console.print(
            f"the detector finds a person in {views} of {shown} pictures of it, which agree on "
            f"{found} of {len(LANDMARKS)} landmarks"
        )
    heat = report.heat
    console.print(
        f"{heat.parts} connected parts, {heat.carried} of them carried by what they lie on; "
        f"{100 * heat.seen:.0f} % of the surface sees a bone"
    )
    if report.measurements is not None:
        console.print("the body in it, under its clothes:")
        print_measures(report.measurements)
    printed = {str(finding) for finding in report.about_actor}  # by who looks at the folder
    for warning in report.warnings:
        if warning not in printed:
            line = f"warning: {warning.removeprefix('warning: ')}"
            console.print(line, style="yellow", soft_wrap=True)


# --- ``perfcap actor build``: an actor folder from what a user has --------------------------------

# what the command asks about a person
_MEASURES = tuple(f.name for f in fields(Person) if f.name in {o.name for o in fields(ActorBuild)})


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
    read = (request.source, request.mapping, request.overrides)
    spare_sources(request.out, request.body_model, [path for path in read if path is not None])
    spare_files(request.out)
    actor, licence, provenance, measurements = _made(request, _person(request))
    if request.name is not None:
        actor = Actor(replace(actor.template, name=request.name), actor.skeleton.rig)
    spare_actor(request.out, actor.template.name)
    Appearance.of(actor.template)  # whether the texture can be decoded, before anything is written

    def beside(folder: Path) -> None:
        if measurements is not None:
            save_measures(folder, measurements, None, provenance)

    rights = request.licence or licence
    save_actor(actor, request.out, licence=rights, provenance=provenance, beside=beside)
    code = run_inspect(str(request.out), None, request.out)
    PlainConsole().print(f"capture with --actor {request.out}", soft_wrap=True)
    return code


def spare_sources(folder: Path, body_model: str, paths: Iterable[Path] = ()) -> None:
    """Refuse a folder of an actor in which what it is made of would be replaced or removed.

    Args:
        folder: of the actor.
        body_model: name, file or folder of the body model.
        paths: files that are read besides.

    Raises:
        InputError: an input has the place of a file of an actor.
    """
    for path in (*paths, Path(body_model), Path(body_model) / BODY):
        for name in (MESH, MANIFEST, *BESIDE):
            if same_file(path, folder / name):
                raise InputError(
                    f"--out {folder}: {name} of the actor would replace the input {path}; "
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
