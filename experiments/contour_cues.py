"""What each part of the contour energy is worth, how many Gaussians, and which backgrounds.

On takes of ``contour_takes.py``, which settings were chosen on: differences count, not levels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from contour_takes import Place, Take, film
from report import Report, Table
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.volume import GaussianCentres, Volume
from perfcap.actor.volume_fit import fit_volume
from perfcap.energy.density_contour import DensityContour
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.images import Images
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.objective import FrameProblem, angle_bounds
from perfcap.pipeline.prepare import prepare, relaxed
from perfcap.pipeline.presets import RHODIN
from perfcap.pipeline.refine_contours import ContourSight
from perfcap.pipeline.track_twice import track_twice
from perfcap.segment.edge_field import EdgeField
from perfcap.solve import LevenbergMarquardt, Objective, solve
from perfcap.temporal.window import Window
from perfcap.train.motion_library import MotionLibrary

_TAKES = (
    ("stripes", "rendered/dev_tight/template.glb", "07_08", 63, 3),
    ("plaid", "rendered_multi/dev_trio/person1/template.glb", "06_05", 101, 4),
    ("checks", "rendered_multi/dev_dance/person1/template.glb", "06_11", 410, 5),
)
_TURNED = "without direction"


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    frames: int = 10
    """Of each take."""
    takes: int = 3
    """How many of the people."""
    views: tuple[int, ...] = (6, 2)
    """Numbers of views; two are a third of a circle apart."""


@dataclass(frozen=True)
class Begun:
    """A take in some views, and its motion from joints alone."""

    take: Take
    problem: ClipProblem
    motion: Motion

    def error(self, motion: Motion) -> Tensor:
        """Distance of joints to the truth, (F, 16) mm."""
        found: Tensor = 1000 * (self.problem.actor.joints(motion) - self.take.truth).norm(dim=-1)
        return found


def run(config: Experiment) -> Report:
    """All tables."""
    library = MotionLibrary.read(report.data_folder(config.data, "mocap_cmu_library"))
    cluttered = [_film(config, library, which, "clutter") for which in range(config.takes)]
    tables = [_parts(config, cluttered), _counts(config, cluttered)]
    kinds = []
    for kind in ("plain", "clutter", "noise", "camouflage"):
        takes = cluttered if kind == "clutter" else [
            _film(config, library, which, kind) for which in range(config.takes)
        ]  # fmt: skip
        for views in config.views:
            rows = [_refined(_begin(take, views), lambda field: field) for take in takes]
            kinds.append((kind, views, *_row(rows)))
    columns = ("background", "views", *_COLUMNS)
    tables.append(Table("backgrounds, mm and %", columns, tuple(kinds)))
    return Report(tuple(tables), ("Means over takes; the 95th percentile is of each take's own.",))


_COLUMNS = ("joints alone", "95 %", "contours", "95 %", "support")


def _film(config: Experiment, library: MotionLibrary, which: int, kind: str) -> Take:
    name, actor, clip, start, seed = _TAKES[which]
    place = Place(kind)
    with torch.no_grad():
        return film(name, config.data / actor, library, clip, start, config.frames, seed, place)


def _begin(take: Take, views: int) -> Begun:
    """Joints alone, solved as ``capture`` does."""
    chosen = list(range(6)) if views == 6 else list(range(0, 6, 2))[:views]
    cameras, seen = take.cameras.select(chosen), take.detections.select(chosen)
    some = replace(take, images=[take.images[view] for view in chosen], cameras=cameras)
    prepared = prepare(relaxed(FrameProblem.of(take.actor, cameras, seen, RHODIN.pose)))
    motion, _ = initialize(prepared)
    motion, _, problem = track_twice(ClipProblem.of(prepared.problem, take.rate), motion)
    return Begun(some, problem, motion)


def _refined(
    begun: Begun, changed: Callable[[EdgeField], EdgeField], volume: Volume | None = None
) -> tuple[float, ...]:
    """Errors and support with fields that are changed, or another volume."""
    settings, problem, motion = RHODIN.contours, begun.problem, begun.motion
    volume = volume or fit_volume(problem.actor)
    points = GaussianCentres(problem.actor.skeleton, volume)
    window, heights = Window(0, motion.frames), 100 * problem.pixel_unit
    images = Images(begun.take, begun.take.cameras)
    sight = ContourSight.of(images, heights, settings, heights)
    whole = sight.fields(points(motion), volume, window)
    fields = [[changed(field) for field in row] for row in whole]
    energy = DensityContour(points, volume, sight.cameras, fields, settings.weight, sight.unit)
    energy.offset = -energy.lower_bound(points(motion))
    terms = dict(problem.objective(window).items())
    method = LevenbergMarquardt(settings.max_steps, settings.tolerance)
    objective = Objective({"contours": energy, **terms})
    found: Motion = solve(objective, motion, method, angle_bounds(problem.actor)).state
    before, after = begun.error(motion), begun.error(found)
    seen = DensityContour(points, volume, sight.cameras, whole, 1.0, sight.unit)
    return (
        *(float(v) for e in (before, after) for v in (e.mean(), e.quantile(0.95))),
        100 * float(seen.support(points(found)).mean()),
    )


def _row(rows: list[tuple[float, ...]]) -> tuple[float, ...]:
    return tuple(float(value) for value in np.mean(rows, 0))


def _parts(config: Experiment, takes: list[Take]) -> Table:
    """Terms left out, one at a time."""
    variants: dict[str, Callable[[EdgeField], EdgeField]] = {
        "all": lambda field: field,
        "without E_flat": lambda field: replace(field, flat=0 * field.flat),
        "without E_sim": lambda field: replace(field, edges=0 * field.edges),
        _TURNED: lambda field: replace(
            field, edges=0 * field.edges, flat=field.flat - np.hypot(*field.edges)
        ),
    }
    rows = []
    for views in config.views:
        begun = [_begin(take, views) for take in takes]
        volumes = [fit_volume(each.problem.actor) for each in begun]
        for name, changed in variants.items():
            pairs = zip(begun, volumes, strict=True)
            rows.append((name, views, *_row([_refined(b, changed, v) for b, v in pairs])))
    return Table("parts of the energy, mm and %", ("energy", "views", *_COLUMNS), tuple(rows))


def _counts(config: Experiment, takes: list[Take]) -> Table:
    rows = []
    for views in config.views:
        begun = [_begin(take, views) for take in takes]
        for count in (40, 91, 200):
            found = [
                _refined(each, lambda field: field, fit_volume(each.problem.actor, count))
                for each in begun
            ]
            rows.append((count, views, *_row(found)))
    return Table("Gaussians, mm and %", ("Gaussians", "views", *_COLUMNS), tuple(rows))


if __name__ == "__main__":
    report.main(run, Experiment, "contour_cues")
