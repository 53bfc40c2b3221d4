"""Edges learned through the solve: what a contour should gain and pay, from where joints end up.

A small network looks at an image and at its edges, and says how much each edge counts and what a
unit of contour costs there. Nothing labels pixels: the loss is the distance of joints from the
truth after the solve, and its gradient goes through pose and visibility to the network, which
starts with edges as they are. Held-out takes have other people, motions and places. Expect them no
worse than with edges as they are.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from contour_takes import Place, Take, film
from report import Report, Table
from safetensors.torch import save_file
from torch import Tensor, nn

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
from perfcap.pipeline.refine_contours import ContourSight, Patch
from perfcap.pipeline.track_twice import track_twice
from perfcap.segment.edge_network import EdgeNetwork
from perfcap.segment.edge_tensors import TensorField
from perfcap.solve import (
    Detached,
    Implicit,
    LevenbergMarquardt,
    Newton,
    Objective,
    Sensitivity,
    solve,
)
from perfcap.temporal.window import Window
from perfcap.train.motion_library import MotionLibrary

# whose template, which recording, first frame, seed, what is behind
_LEARNED = (
    ("rendered/dev_tight/template.glb", "07_08", 40, 11, "clutter"),
    ("rendered_multi/dev_trio/person1/template.glb", "06_05", 60, 12, "clutter"),
    ("rendered/dev_skirt/template.glb", "06_11", 200, 13, "noise"),
    ("rendered_multi/dev_trio/person2/template.glb", "01_05", 400, 14, "clutter"),
    ("rendered/dev_coat/template.glb", "02_06", 300, 15, "camouflage"),
    ("rendered_multi/dev_twins/person1/template.glb", "07_11", 30, 16, "clutter"),
    ("rendered_multi/dev_trio/person3/template.glb", "01_09", 900, 17, "noise"),
    ("rendered_multi/dev_twins/person2/template.glb", "02_10", 500, 18, "clutter"),
    ("rendered/dev_coat/template.glb", "06_15", 100, 19, "clutter"),
    ("rendered/dev_tight/template.glb", "01_13", 800, 20, "plain"),
    ("rendered_multi/dev_trio/person2/template.glb", "07_05", 120, 31, "camouflage"),
    ("rendered/dev_skirt/template.glb", "01_02", 1200, 32, "clutter"),
    ("rendered_multi/dev_trio/person1/template.glb", "02_08", 300, 33, "plain"),
    ("rendered_multi/dev_trio/person3/template.glb", "06_02", 150, 34, "clutter"),
)
_HELD_OUT = (
    ("rendered_multi/dev_duo/person1/template.glb", "05_18", 100, 21, "clutter"),
    ("rendered_multi/dev_views/person1/template.glb", "03_01", 60, 22, "clutter"),
    ("rendered_multi/dev_dance/person1/template.glb", "05_17", 200, 23, "noise"),
    ("rendered_multi/dev_duo/person2/template.glb", "05_10", 120, 24, "camouflage"),
    ("rendered_multi/dev_views/person1/template.glb", "05_12", 300, 25, "plain"),
)
_PAIRS = ((0, 2), (1, 3), (3, 5))  # of six views on a circle, a third of it apart


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    frames: int = 6
    """Of each take."""
    learned: int = len(_LEARNED)
    """Takes to learn from."""
    held_out: int = len(_HELD_OUT)
    """Takes to score on."""
    epochs: int = 3
    """Passes through all pairs of views of all takes."""
    learning_rate: float = 2e-3
    seeds: tuple[int, ...] = (0,)
    """Of the network and of the order."""
    save: Path | None = None
    """Where the weights of the last seed go, .safetensors."""


@dataclass(frozen=True)
class Begun:
    """A take in two views, its motion from joints alone, and the parts of images about it."""

    name: str
    take: Take
    problem: ClipProblem
    motion: Motion
    volume: Volume
    sight: ContourSight
    patches: list[list[Patch]]

    @property
    def window(self) -> Window:
        """All frames."""
        return Window(0, self.motion.frames)

    def error(self, motion: Motion) -> Tensor:
        """Distance of joints to the truth, (F, 16) mm."""
        found: Tensor = 1000 * (self.problem.actor.joints(motion) - self.take.truth).norm(dim=-1)
        return found

    def refined(self, network: EdgeNetwork, learning: bool) -> tuple[Motion, int]:
        """The motion whose contours meet the edges, and what its gradient is."""
        settings = RHODIN.contours
        points = GaussianCentres(self.problem.actor.skeleton, self.volume)
        fields = [[_field(network, patch) for patch in row] for row in self.patches]
        energy = DensityContour(
            points, self.volume, self.sight.cameras, fields, settings.weight, self.sight.unit
        )
        energy.offset = -energy.lower_bound(points(self.motion))
        terms = dict(self.problem.objective(self.window).items())
        method = LevenbergMarquardt(settings.max_steps, settings.tolerance)
        solution = solve(
            Objective({"contours": energy, **terms}),
            self.motion,
            Newton(method, max_steps=5, tolerance=1e-7) if learning else method,
            angle_bounds(self.problem.actor),
            Implicit() if learning else Detached(),
        )
        kind = solution.sensitivity
        return solution.state, int(Sensitivity.ZERO if kind is None else kind)


def run(config: Experiment) -> Report:
    """Errors before and after learning."""
    library = MotionLibrary.read(report.data_folder(config.data, "mocap_cmu_library"))
    learned = _begun(config, library, _LEARNED[: config.learned])
    held_out = _begun(config, library, _HELD_OUT[: config.held_out])
    before = [_scored(EdgeNetwork(), held_out), _scored(EdgeNetwork(), learned)]
    rows, last = [], EdgeNetwork()
    for seed in config.seeds:
        start = time.process_time()
        network, exact = _learn(config, learned, seed)
        spent = (time.process_time() - start) / 60
        after = [_scored(network, held_out), _scored(network, learned)]
        for name, old, new in zip(("held out", "learned from"), before, after, strict=True):
            change = 100 * (float(new[:, 1].mean()) / float(old[:, 1].mean()) - 1)
            rows.append((seed, name, float(old[:, 0].mean()), float(old[:, 1].mean()),
                         float(new[:, 1].mean()), change, exact, spent))  # fmt: skip
        last = network
        if config.save is not None:
            save_file(network.state_dict(), config.save)
    each = [
        (begun.name, *(float(v) for v in old), float(new[1]))
        for begun, old, new in zip(held_out, before[0], _scored(last, held_out), strict=True)
    ]
    columns = ("seed", "takes", "joints alone", "edges as they are", "learned", "change, %",
               "exact gradients, %", "CPU min")  # fmt: skip
    single = ("held out", "joints alone", "edges as they are", "learned")
    tables = (
        Table("mean distance of joints to the truth, mm", columns, tuple(rows)),
        Table("take by take, the last seed, mm", single, tuple(each)),
    )
    return Report(tables, ("Two views, a third of a circle apart; means over pairs of them.",))


def _begun(
    config: Experiment, library: MotionLibrary, takes: Sequence[tuple[str, str, int, int, str]]
) -> list[Begun]:
    found = []
    for actor, clip, first, seed, kind in takes:
        with torch.no_grad():
            take = film(clip, config.data / actor, library, clip, first, config.frames, seed,
                        Place(kind))  # fmt: skip
        volume = fit_volume(take.actor)
        found += [_begin(take, pair, volume, f"{clip}, {kind}") for pair in _PAIRS]
    return found


def _begin(take: Take, views: tuple[int, int], volume: Volume, name: str) -> Begun:
    """Joints alone, solved as ``capture`` does."""
    chosen = list(views)
    cameras, seen = take.cameras.select(chosen), take.detections.select(chosen)
    some = replace(take, images=[take.images[view] for view in chosen], cameras=cameras)
    prepared = prepare(relaxed(FrameProblem.of(take.actor, cameras, seen, RHODIN.pose)))
    motion, _ = initialize(prepared)
    motion, _, problem = track_twice(ClipProblem.of(prepared.problem, take.rate), motion)
    heights = 100 * problem.pixel_unit
    sight = ContourSight.of(Images(some, cameras), heights, RHODIN.contours, heights)
    points = GaussianCentres(problem.actor.skeleton, volume)
    patches = sight.patches(points(motion), volume, Window(0, motion.frames))
    return Begun(f"{name}, {views}", some, problem, motion, volume, sight, patches)


def _field(network: EdgeNetwork, patch: Patch) -> TensorField:
    image = torch.from_numpy(patch.pixels).permute(2, 0, 1).float() / 255
    top, left = patch.corner[0] - patch.first[0], patch.corner[1] - patch.first[1]
    height, width = patch.size
    whole = network(image)[:, top : top + height, left : left + width]
    return TensorField.of(whole, patch.corner)


def _scored(network: EdgeNetwork, takes: Sequence[Begun]) -> Tensor:
    """Mean errors, mm: of joints alone and of contours, (N, 2)."""
    with torch.no_grad():
        found = [(t.error(t.motion), t.error(t.refined(network, learning=False)[0])) for t in takes]
    return torch.tensor([[float(each.mean()) for each in pair] for pair in found])


def _learn(config: Experiment, takes: Sequence[Begun], seed: int) -> tuple[EdgeNetwork, float]:
    """The network, and how many gradients were exact, %."""
    torch.manual_seed(seed)
    network, draw = EdgeNetwork(), np.random.default_rng(seed)
    optimizer = torch.optim.Adam(network.parameters(), config.learning_rate)
    steps = config.epochs * len(takes)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    exact = 0
    for epoch in range(config.epochs):
        errors = []
        for index in draw.permutation(len(takes)):
            begun = takes[index]
            motion, kind = begun.refined(network, learning=True)
            loss = begun.error(motion).mean()
            exact += kind == Sensitivity.EXACT
            errors.append(float(loss.detach()))
            optimizer.zero_grad()
            if motion.angles.requires_grad:
                loss.backward()
                nn.utils.clip_grad_norm_(network.parameters(), 1.0)
                optimizer.step()
            schedule.step()
        print(f"seed {seed}, epoch {epoch}: {np.mean(errors):.2f} mm", flush=True)
    return network, 100 * exact / steps


if __name__ == "__main__":
    report.main(run, Experiment, "learned_edges")
