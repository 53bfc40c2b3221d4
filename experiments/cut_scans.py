"""What `perfcap actor build` says of scans that are not all there.

Clothed templates of the rendered sequences lose their bones, then a crown, soles, or a part of an
arm or leg, and are rigged with the height of the whole person. Thresholds were chosen with the same
templates in view, and on unclothed bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from report import DATA, Report, Table, data_folder, main

from perfcap.actor.bare_mesh import BareMesh
from perfcap.io.body_model import load_body_model
from perfcap.rigging import auto_rig

Floats = NDArray[np.float64]
Cut = Callable[[Floats, Floats, float], NDArray[np.bool_]]

# by what is missing: the sentence that says so, and the vertices that are kept, of how high and how
# far to the left they are, metres
CUTS: dict[str, tuple[str, Cut]] = {
    "crown": ("the crown", lambda up, _, cut: up < up.max() - cut),
    "soles": ("goes no deeper", lambda up, _, cut: up > cut),
    "left hand": ("look at the colours", lambda _, left, cut: left < left.max() - cut),
    "left foot": ("look at the colours", lambda up, left, cut: (up > cut) | (left < 0)),
}


@dataclass(frozen=True)
class Experiment:
    """What to cut.

    Attributes:
        data: folder of the recordings.
        sequences: folders of rendered people there, with a template.
        crown: metres of the head that are missing, each.
        soles: of the feet.
        arm: of the left arm.
        leg: of the left leg.
    """

    data: Path = DATA
    sequences: tuple[str, ...] = (
        "rendered/dev_coat",
        "rendered/dev_skirt",
        "rendered/dev_tight",
        "rendered_multi/dev_trio/person1",
        "rendered_multi/dev_views/person1",
    )
    crown: tuple[float, ...] = (0.0, 0.03, 0.06, 0.1)
    soles: tuple[float, ...] = (0.02, 0.04)
    arm: tuple[float, ...] = (0.15, 0.3)
    leg: tuple[float, ...] = (0.08,)


def run(config: Experiment) -> Report:
    """How many are named, by what is missing."""
    kinds = zip(CUTS, (config.crown, config.soles, config.arm, config.leg), strict=True)
    rows = [_row(config, kind, cut) for kind, cuts in kinds for cut in cuts]
    columns = ("missing", "cm", "scans", "named", "named otherwise", "too large, %")
    return Report((Table("Scans that are not all there", columns, tuple(rows)),))


def _row(config: Experiment, kind: str, cut: float) -> tuple[str, float, int, int, int, float]:
    says, keeps = CUTS[kind]
    found = list(_rigged(config, keeps, cut))
    named = [any(says in line for line in lines) for lines, _ in found]
    others = [any(says not in line for line in lines) for lines, _ in found]
    larger = 100 * (float(np.mean([scale for _, scale in found])) - 1)
    return kind, 100 * cut, len(found), sum(named), sum(others), larger


def _rigged(config: Experiment, keeps: Cut, cut: float) -> Iterator[tuple[tuple[str, ...], float]]:
    """What is said of each scan, and how much too large it becomes."""
    model = load_body_model()
    for name in config.sequences:
        with np.load(data_folder(config.data, name) / "template.npz") as template:
            vertices, faces = template["vertices"].astype(float), template["faces"].astype(np.int64)
        up = vertices[:, 1] - vertices[:, 1].min()
        kept = keeps(up, vertices[:, 0], cut)
        faces = (np.cumsum(kept) - 1)[faces[kept[faces].all(1)]]
        mesh = BareMesh(vertices[kept], faces, name=name)
        _, report = auto_rig(mesh, model, height=float(up.max()))
        yield report.warnings, float(up.max() / np.ptp(vertices[kept, 1]))


if __name__ == "__main__":
    main(run, Experiment, "cut_scans")
