"""Arrays given to the Python API, and what they are given to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from fuzzing import mutate
from fuzzing.mutate import Random
from fuzzing.targets import Target, spoiled
from takes import make_take

from perfcap.pipeline import PoseRefiner, Stage, capture


def arrays(root: Path) -> list[Target]:
    """A capture and a refinement, of arrays that are spoiled one at a time."""
    take, nothing = make_take(6), root / "arrays"
    nothing.mkdir(parents=True)
    refiner = PoseRefiner(take.actor, joint_set="landmarks16", rate=30.0)
    for kind in (torch.float32, torch.float64):  # compiled here, too
        seen = take.detections.to(torch.zeros((), dtype=kind))
        capture(take.actor, take.cameras, seen, take.rate, until=Stage.INITIALIZE)
        for shape in (seen.joints2d, seen.joints2d[None]):
            refiner.to(kind)(take.cameras, shape)

    def change(rng: Random, thing: Any, names: tuple[str, ...]) -> Any:
        name = rng.choice(names)
        values = getattr(thing, name)
        return replace(thing, **{name: spoiled(rng, values)})

    def solve(_: Path, rng: Random) -> Any:
        detections, cameras, rate = take.detections, take.cameras, take.rate
        kind = rng.randrange(3)
        if kind == 0:
            names = ("joints2d", "confidence2d", "joints3d", "trusted3d")
            detections = change(rng, detections, names)
        elif kind == 1:
            names = ("intrinsics", "rotation", "translation")
            cameras = change(rng, cameras, names)
        else:
            rate = rng.choice((*mutate.NUMBERS, "x", None))
        found = capture(take.actor, cameras, detections, rate, until=Stage.INITIALIZE)
        return found.motion.translation, found.motion.rotation, found.motion.angles

    def refine(_: Path, rng: Random) -> Any:
        pixels = spoiled(rng, take.detections.joints2d)
        found = refiner(take.cameras, pixels)
        return found.joints

    refused = (ValueError, TypeError)
    return [
        Target("arrays_capture", nothing, solve, refused, False, 0.3),
        Target("arrays_refiner", nothing, refine, refused, False, 0.02),
    ]
