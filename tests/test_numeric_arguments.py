"""Numbers that cannot be what they are called are refused where they are given, by name.

Not a number, below zero, infinite, a fraction of a count: each was accepted by something once, and
came out as NaN, as nothing found, or as a solve that had converged before it began.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import synthetic
import torch

import perfcap
from perfcap import actor, detect, energy, geometry, metrics, render, rigging, segment, solve
from perfcap.errors import InputError
from perfcap.io import CameraRig, VideoWriter, save_animation, save_surface
from perfcap.pipeline import TrajectoryConfig, trajectory_prior
from perfcap.temporal import Window, binomial, box, dct_basis, partition

F64 = torch.float64
NAN, INF = float("nan"), float("inf")
COUNT = (-1, 0, 2.5, NAN, INF, True)  # no number of things
INDEX = (-1, 2.5, NAN, INF)  # no number from 0 on
SIZE = (-1.0, 0.0, NAN, INF)  # nothing to divide by
UNIT = (-1.0, 0.0, NAN)  # infinite ones switch a term off
AMOUNT = (-1.0, NAN, INF)  # no number from 0 on
PLACE = (NAN, INF)

UP = torch.tensor([0.0, 1, 0], dtype=F64)
ERRORS, VALID = torch.ones(2, 16, dtype=F64), torch.ones(2, 16, dtype=torch.bool)
MASK = torch.ones(1, 8, 8, dtype=torch.bool)
TETRA = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@cache
def points() -> Any:
    return synthetic.actor().landmarks


@cache
def lit() -> tuple[Any, ...]:
    return torch.from_numpy(TETRA), torch.from_numpy(FACES), render.Lighting()


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def triangulated(**given: Any) -> Any:
    plane, weights = torch.zeros(1, 2, 1, 2, dtype=F64), torch.ones(1, 2, 1, dtype=F64)
    return geometry.triangulate(synthetic.cameras(2), plane, weights, **given)


def on_ground(**given: Any) -> Any:
    camera = synthetic.cameras(1, size=8)
    return render.shade_ground(torch.zeros(8, 8, 3, dtype=torch.uint8), camera, *lit(), **given)


def floor(**given: Any) -> Any:
    ones = torch.ones(2, 16, dtype=F64)
    return energy.FloorPenetration(points(), UP, **{"height": 0.0, "confidence": ones} | given)


def hinge(**given: Any) -> Any:
    sound = {"name": "bend", "joint": "l_knee", "axis": (1.0, 0, 0), "lower": -1.0, "upper": 1.0}
    return actor.Hinge(**sound | given)


def written(path: Path = Path("surface.npz"), **given: Any) -> Any:
    return save_surface(path, [TETRA[None]], FACES, np.arange(1), **given)


Make = Callable[..., Any]
CASES: tuple[tuple[Make, dict[str, tuple[Any, ...]]], ...] = (
    (solve.Adam, {"max_steps": INDEX, "learning_rate": SIZE, "tolerance": AMOUNT}),
    (solve.LevenbergMarquardt, {"max_steps": INDEX, "tolerance": AMOUNT, "damping": SIZE}),
    (
        solve.TruncatedNewton,
        dict.fromkeys(("max_steps", "max_rounds"), INDEX)
        | dict.fromkeys(("tolerance", "damping", "forcing"), AMOUNT),
    ),
    (solve.Implicit, {"damping": AMOUNT}),
    (solve.Unrolled, {"steps": COUNT}),
    (solve.Huber, {"scale": SIZE}),
    (solve.GemanMcClure, {"scale": SIZE}),
    (
        partial(energy.BoneLengthPrior, groups=3, frames=2),
        {"groups": COUNT, "frames": COUNT, "size": AMOUNT, "own": SIZE, "weight": AMOUNT},
    ),
    (
        partial(energy.SharedPrior, components=3),
        {"components": COUNT, "frames": COUNT, "deviation": UNIT, "weight": AMOUNT},
    ),
    (partial(energy.Tether, nodes=4), {"nodes": COUNT, "weight": AMOUNT, "unit": UNIT}),
    (
        partial(energy.Trajectory, frames=6, rank=3),
        {"frames": COUNT, "rank": COUNT, "weight": AMOUNT, "translation": AMOUNT}
        | {"rotation": AMOUNT, "angles": AMOUNT},
    ),
    (
        lambda **given: energy.JointTrajectory(points(), **{"frames": 6, "rank": 3} | given),
        {"frames": COUNT, "rank": COUNT, "unit": UNIT},
    ),
    (floor, {"height": PLACE, "unit": UNIT, "weight": AMOUNT}),
    (
        partial(trajectory_prior, frames=10, rate=30.0, config=TrajectoryConfig()),
        {"frames": COUNT, "rate": SIZE},
    ),
    (box, {"width": (*COUNT, 4)}),
    (binomial, {"width": (*COUNT, 4)}),
    (partial(dct_basis, frames=6, rank=3), {"frames": COUNT, "rank": (*COUNT, 7)}),
    (
        partial(partition, frames=100),
        {"frames": COUNT, "length": COUNT, "overlap": (*INDEX, 50)},
    ),
    (partial(Window, start=2, stop=5), {"start": (*INDEX, 5), "stop": (*COUNT, 2)}),
    (triangulated, {"rounds": INDEX, "scale": UNIT}),
    (partial(metrics.correct_share, ERRORS, VALID), {"threshold": UNIT}),
    (partial(metrics.area_under_curve, ERRORS, VALID), {"thresholds": ((), (NAN,), (-1.0,))}),
    (
        partial(metrics.limit_violations, ERRORS, -ERRORS[0], ERRORS[0]),
        {"tolerance": AMOUNT},
    ),
    (partial(metrics.penetration, ERRORS), {"tolerance": AMOUNT}),
    (partial(metrics.boundary_f, MASK, MASK), {"radius": INDEX}),
    (
        partial(metrics.surface_distance, TETRA, FACES, TETRA, FACES, rng()),
        {"samples": COUNT, "queries": COUNT},
    ),
    (
        partial(metrics.surface_error, TETRA, TETRA, FACES, rng()),
        {"samples": COUNT, "queries": COUNT},
    ),
    (lambda **given: render.visibility(*lit(), **given), {"sun": COUNT, "sky": COUNT}),
    (on_ground, {"ground": PLACE, "sun": COUNT, "sky": COUNT}),
    (render.OverlayStyle, {"tint": (NAN, -1.0), "outline_width": (NAN, -1.0)}),
    (segment.Matching, {"distance": (NAN, -1.0), "squeeze": (NAN, -1.0)}),
    (segment.Tracing, {"reach": (NAN, -1.0), "smallest": (NAN, -1.0)}),
    (
        partial(detect.Crop, center=(1.0, 2.0), width=10.0, size=(4, 4)),
        {"width": SIZE, "angle": PLACE},
    ),
    (detect.Execution, {"threads": COUNT}),
    (
        partial(detect.HeatmapHead, channels=8),
        {"channels": COUNT, "doublings": INDEX, "hidden": COUNT, "spread": SIZE},
    ),
    (hinge, {"lower": (NAN, 2.0), "upper": (NAN, -2.0), "rest": PLACE}),
    (
        partial(rigging.Override, "hair", ("head",), part=0),
        {"part": INDEX, "blend": (-0.1, 1.0, NAN)},
    ),
    (
        lambda **given: CameraRig(("a",), synthetic.cameras(1), **given),
        {"fps": SIZE, "pixel_offset": PLACE},
    ),
    (partial(VideoWriter, "video.mp4", fps=30.0), {"fps": SIZE, "crf": (*INDEX, 52)}),
    (written, {"rate": SIZE}),
    (
        partial(perfcap.Clip, [[0, 1, 2]], fps=30.0),
        {"fps": SIZE, "start": INDEX, "stop": COUNT, "sources": ((),)},
    ),
)
FLAT = [
    pytest.param(make, name, value, id=f"{number}-{name}-{value}")
    for number, (make, names) in enumerate(CASES)
    for name, values in names.items()
    for value in values
]


@pytest.mark.parametrize(("make", "name", "value"), FLAT)
def test_numbers_that_are_none(make: Make, name: str, value: object, tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)  # nothing is written, here or elsewhere
    if isinstance(make, partial) and name == "sources":
        make = partial(make.func, **make.keywords)
    with pytest.raises(InputError, match=name.split("_")[0].rstrip("s")):
        make(**{name: value})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", range(len(CASES)))
def test_all_makers_make_something(number: int, tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """What the test above refuses is refused for its number."""
    monkeypatch.chdir(tmp_path)
    make, names = CASES[number]
    required = {"scale": 1.0} if make in (solve.Huber, solve.GemanMcClure) else {}
    make(**required | ({"rate": 30.0} if make is written else {}))
    assert names


def test_files_say_what_they_are(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """A video was written into ``motion.txt``, and a glTF into ``dance.fbx``."""
    with pytest.raises(InputError, match=r"motion\.txt: .* ends in \.mp4"):
        VideoWriter(tmp_path / "motion.txt", 30.0)
    still = np.tile(np.eye(4), (2, len(synthetic.template().bone_names), 1, 1))
    with pytest.raises(InputError, match=r"dance\.fbx: .* end the name in \.glb"):
        save_animation(tmp_path / "dance.fbx", synthetic.template(), still, 30.0)
    assert not list(tmp_path.iterdir())
