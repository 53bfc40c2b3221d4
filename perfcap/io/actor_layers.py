"""Bodies that a character's file holds more than once, one inside the other."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from perfcap.actor.template import Template
from perfcap.io.actor_check import winding_numbers
from perfcap.io.actor_limbs import joint_places
from perfcap.io.doctor.finding import Finding, Severity

_INSIDE = 0.5  # winding number of a place within a body; 1 in a closed surface
_NEARLY_ALL = 14  # joints of 16 that a whole body surrounds, its head among them
_LEVEL = re.compile(r"[ _.-]?lod[ _.-]?\d+", re.IGNORECASE)
_REMEDY = "all of them would be captured; delete all but one in Blender and export again"


def layer_findings(template: Template, parts: Sequence[tuple[str, int]]) -> Iterator[Finding]:
    """That several meshes of a file are the whole body: levels of detail, copies, cages.

    Clothes are none: they leave the head out, as hair leaves the rest.

    Args:
        template: with joints.
        parts: name of the mesh and number of vertices of each part, in the order of the vertices.
    """
    named = list(dict.fromkeys(name for name, _ in parts))
    bases = {name: _LEVEL.sub("", name) for name in named if _LEVEL.search(name)}
    levels = [name for name in bases if [*bases.values()].count(bases[name]) > 1]
    whole = [] if levels or len(named) < 2 else _whole_bodies(template, parts)
    if levels:
        what = f"{_listed(levels)} are levels of detail of one another"
        yield Finding(Severity.WARNING, "mesh", what, _REMEDY)
    elif len(whole) > 1:
        what = f"{_listed(whole)} are each a whole body, one inside the other"
        yield Finding(Severity.WARNING, "mesh", what, _REMEDY)


def _whole_bodies(template: Template, parts: Sequence[tuple[str, int]]) -> list[str]:
    """Meshes within which nearly all joints lie."""
    names = np.repeat([name for name, _ in parts], [count for _, count in parts])
    of_face = names[template.faces[:, 0]]
    places = joint_places(template)
    points = np.stack([*places.values()])
    head = list(places).index("head")
    found = []
    for name in dict.fromkeys(name for name, _ in parts):
        corners = template.vertices[template.faces[of_face == name]]
        inside = np.abs(winding_numbers(points, corners)) > _INSIDE
        if inside[head] and inside.sum() >= _NEARLY_ALL:
            found.append(name)
    return found


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(f"{name!r:.40}" for name in names[:4])
    return shown if len(names) <= 4 else f"{shown}, ..."
