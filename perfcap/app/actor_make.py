"""Actors for those who have no rig: of a bare mesh, or of nothing but a person's measures."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.measurements import Measurements
from perfcap.app.console import PlainConsole
from perfcap.app.measures import print_measures
from perfcap.app.networks import DETECTORS, find_model
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.onnx import OnnxDetector
from perfcap.errors import InputError
from perfcap.io.actor_check import examine_actor
from perfcap.io.actor_import import require_sound
from perfcap.io.body_model import load_body_model
from perfcap.io.gltf_document import open_document
from perfcap.io.mesh import FORMATS, read_mesh
from perfcap.rigging import Person, RigReport, auto_rig, build_body, read_overrides

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
    template, report = auto_rig(
        mesh, load_body_model(how.body), how.height, rules, detector=detector
    )
    _print_rig(report)
    joints = {name: template.bone(name) for name in JOINTS}
    require_sound(source, examine_actor(replace(template, joint_bones=joints)))
    return Actor(template.rounded()), report.measurements


def body_of(person: Person, body: str, name: str | None) -> tuple[Actor, str, Measurements]:
    """A body with what is known of a person, its licence, and what it measures."""
    model = load_body_model(body)
    built = build_body(model, person)
    print_measures(built.measurements, weight=built.weight)
    for line in built.doubts(person):
        _LOG.warning("%s", line)
    template = replace(built.template, name=name or model.rig.name).rounded()
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
    for warning in report.warnings:
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)
