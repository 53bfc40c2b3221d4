"""``perfcap actor inspect``: what an actor is, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.table import Table

from perfcap.app.actor_sheet import save_sheet
from perfcap.app.console import PlainConsole
from perfcap.app.doctor import COLORS
from perfcap.io.actor import Examination, examine
from perfcap.io.actor_place import SHEET
from perfcap.io.atomic import unwritable
from perfcap.io.doctor import Severity
from perfcap.io.image_file import image_size


def run_inspect(actor: str, mapping: Path | None, out: Path | None) -> int:
    """Print it and, if wanted, draw the contact sheet; 2 when something would spoil a capture.

    Raises:
        InputError: the actor cannot be read, or its joints cannot be found.
    """
    found = examine(actor, mapping)
    console = PlainConsole()
    print_summary(console, found)
    for finding in found.findings:
        console.print(str(finding), style=COLORS[finding.severity], soft_wrap=True)
    errors = sum(finding.severity is Severity.ERROR for finding in found.findings)
    console.print(f"{errors} errors, {len(found.findings) - errors} other findings")
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(out, error) from None
        save_sheet(found.actor, out / SHEET)
        console.print(f"look at {out / SHEET}", soft_wrap=True)
    return 2 if errors else 0


def print_summary(console: PlainConsole, found: Examination) -> None:
    """What an actor is, as two tables."""
    table = Table(show_header=False)
    for fact in _facts(found):
        table.add_row(*fact)
    console.print(table)
    joints = Table("joint", "bone", "found by")
    for row in found.rows:
        joints.add_row(*row)
    console.print(joints)


def _facts(found: Examination) -> Iterator[tuple[str, str]]:
    template = found.actor.template
    low, high = template.vertices.min(0), template.vertices.max(0)
    yield "actor", str(found.path)
    yield "licence", found.manifest.licence
    yield "provenance", found.manifest.provenance
    yield "mesh", f"{len(template.vertices)} vertices, {len(template.faces)} triangles"
    if found.parts:
        yield "parts", ", ".join(f"{name} ({count})" for name, count in found.parts)
    yield "height", f"{high[1] - low[1]:.3f} m"
    yield "file", found.space
    extra = len(template.bone_names) - len(set(template.joint_bones.values()))
    yield "bones", f"{len(template.bone_names)}, of which {extra} move with others"
    yield "names", found.convention
    moved = np.count_nonzero(template.weights, axis=1)
    yield "weights", f"{moved.mean():.1f} bones a vertex, at most {moved.max()}"
    if template.texture is None or template.texture_mime is None:
        yield "texture", "none"
    else:
        width, height = image_size(template.texture) or (0, 0)
        kind = template.texture_mime.removeprefix("image/").upper()
        yield "texture", f"{width} x {height} {kind}, {len(template.texture) / 1024:.0f} KiB"
    if found.manifest.limits:
        yield "limits", ", ".join(found.manifest.limits)
    if found.manifest.shape_space:
        yield "shape space", found.manifest.shape_space
