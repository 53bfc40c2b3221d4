"""Actors for those who have no rig: of a bare mesh, or of nothing but a person's measures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rich.console import Console

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.measurements import Measurements
from perfcap.app.measures import print_measures
from perfcap.errors import InputError
from perfcap.io.actor_check import examine_actor
from perfcap.io.actor_import import require_sound
from perfcap.io.body_model import load_body_model
from perfcap.io.gltf_document import open_document
from perfcap.io.mesh import FORMATS, read_mesh
from perfcap.rigging import Person, RigReport, auto_rig, build_body, read_overrides

GENDERS = {"male": 0.0, "female": 1.0}


def is_bare(source: Path) -> bool:
    """Whether a file holds a mesh without bones."""
    suffix = source.suffix.lower()
    if suffix not in (".glb", ".gltf"):
        return suffix in FORMATS
    return not open_document(source).items("skins")


def rigged_mesh(
    source: Path, body: str, height: float | None, overrides: Path | None
) -> tuple[Actor, Measurements | None]:
    """A mesh with a skeleton and weights of its own, and what the body in it measures.

    Raises:
        InputError: it cannot be read, or is not of one person in a T- or A-pose.
    """
    rules = () if overrides is None else read_overrides(overrides)
    mesh = read_mesh(source)
    if height is not None:
        Person(height=height)  # refuses what no person is
    template, report = auto_rig(mesh, load_body_model(body), height, rules)
    _print_rig(report)
    joints = {name: template.bone(name) for name in JOINTS}
    require_sound(source, examine_actor(replace(template, joint_bones=joints)))
    return Actor(template.rounded()), report.measurements


def body_of(person: Person, body: str, name: str | None) -> tuple[Actor, str, Measurements]:
    """A body with what is known of a person, its licence, and what it measures."""
    model = load_body_model(body)
    built = build_body(model, person)
    print_measures(built.measurements, weight=built.weight)
    template = replace(built.template, name=name or model.rig.name).rounded()
    return Actor(template), model.rig.licence, built.measurements


def require_no_source(source: Path | None) -> None:
    """Refuse a file beside ``--body``."""
    if source is not None:
        raise InputError(
            f"--body makes a person of measures alone, but {source} was given; leave one of them"
        )


def _print_rig(report: RigReport) -> None:
    console = Console(highlight=False)
    upright, fit = report.upright, report.fit
    if upright is not None and fit is not None:
        console.print(
            f"taken to be in {upright.unit}, scaled by {upright.scale:g}; a body fits within "
            f"{1e3 * fit.distance:.0f} mm (median)"
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
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True, markup=False)
