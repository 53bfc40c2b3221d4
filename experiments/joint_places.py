"""Where joints of sound bodies lie in their limbs, and lengths of limbs against each other.

What ``perfcap actor inspect`` says about limbs is limited by these. Bodies are drawn from `ada`
with coefficients of one deviation, and from the `anny` package, adults and children. Places are
those where weights cross over, in lengths of the limb from the joint.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from anny_people import People
from report import Report, Table, main

from perfcap.actor.anatomy import JOINTS
from perfcap.io.actor import load_actor
from perfcap.io.actor_limbs import crossing_shares, limb_findings, proportions
from perfcap.io.body_model import load_body_model

_CHILDREN = {"age": (0.15, 0.6), "height": (0.1, 0.9), "weight": (0.0, 1.0)}


@dataclass(frozen=True)
class Experiment:
    """What to look at."""

    characters: tuple[Path, ...] = ()
    """Files of characters, besides."""
    people: int = 100
    """Of each kind."""


def run(config: Experiment) -> Report:
    """Ranges over each kind of bodies."""
    drawn = list(bodies(config.people))
    named = sum(told for _, told in drawn)
    tables = [_table(f"ada, of which {named} are named", [row for row, _ in drawn])]
    for name, children in (("adults", False), ("children", True)):
        tables.append(_table(f"anny, {name}", list(people(config.people, children))))
    for file in config.characters:
        template = load_actor(file).template
        found = len(list(limb_findings(template)))
        row = {**proportions(template), **crossing_shares(template)}
        tables.append(_table(f"{file}, {found} findings", [row]))
    return Report(tuple(tables))


def bodies(count: int) -> Iterator[tuple[dict[str, float], bool]]:
    """Ratios and places of bodies of the shipped model, and whether something is said of them."""
    model = load_body_model("ada")
    generator = torch.Generator().manual_seed(0)
    for _ in range(count):
        shape = torch.randn(model.surface.components, generator=generator, dtype=torch.float64)
        template = model.template(shape)
        template = replace(template, joint_bones={name: template.bone(name) for name in JOINTS})
        found = proportions(template), crossing_shares(template)
        yield {**found[0], **found[1]}, any(True for _ in limb_findings(template))


def people(count: int, children: bool) -> Iterator[dict[str, float]]:
    """Ratios of people of the `anny` package."""
    drawn = People(0)
    sam = load_actor("sam").template
    for _ in range(count):
        shape = drawn.shape()
        if children:
            shape |= {name: float(drawn.rng.uniform(*ends)) for name, ends in _CHILDREN.items()}
        person = drawn.pose(shape, (30.0, 31.0))
        rest = np.tile(np.eye(4), (len(sam.bone_names), 1, 1))
        for name, bone in sam.joint_bones.items():
            rest[bone, :3, 3] = person.rest_joints[name]
        crown = person.rest_joints["head"].copy()
        crown[1] = person.rest[:, 1].max()
        ends = {name: person.rest_joints[name] for name in ("l_toe", "r_toe")} | {"head_top": crown}
        landmarks = {name: (sam.landmarks[name][0], place) for name, place in ends.items()}
        yield proportions(replace(sam, bone_rest=rest, landmarks=landmarks))


def _table(name: str, rows: list[dict[str, float]]) -> Table:
    lines = []
    for key in rows[0]:
        values = np.array([row[key] for row in rows if key in row])
        lines.append((key, float(values.min()), float(np.median(values)), float(values.max())))
    return Table(name, ("what", "least", "median", "most"), tuple(lines), 2)


if __name__ == "__main__":
    main(run, Experiment, "joint_places")
