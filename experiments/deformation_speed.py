"""CPU time of deforming a surface onto a silhouette, one frame (Xu et al. 2018, Eq. 16 to 18).

The default actor's graph of about 1000 nodes, one camera, two rounds of correspondences with the
rigidity weights 0.6 and 0.2. The silhouette is that of the same surface moved by smooth waves. The
best energy of a round is where a strict solve of it ends. One thread and its CPU time, which other
programs on the same cores still lengthen: compare rows of one run.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import report
import torch
from deformation_problem import Scene
from report import Report, Table

from perfcap.energy.contour_alignment import ContourAlignment
from perfcap.energy.rigidity import Rigidity
from perfcap.solve import TruncatedNewton, solve
from perfcap.solve.coarse import coarse_correction
from perfcap.solve.conjugate_gradient import conjugate_gradients
from perfcap.solve.sparse_problem import SparseProblem

_STRICT = TruncatedNewton(max_steps=100, tolerance=1e-10, forcing=1e-3)
_REPEATS = 15
_COLUMNS = ("round", "points", "steps", "build ms", "solve ms", "start", "end", "above best, %")


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    nodes: int = 1000
    """Of the graph."""
    surfaces: int = 4
    """Other waves each."""
    size: int = 1000
    """Pixels of the image's sides."""
    amplitude: float = 0.02
    """Metres that the waves move the surface."""
    stretch: float = 0.003
    """Metres of an edge of the graph that count as one."""
    rigidity: tuple[float, ...] = (0.6, 0.2)
    """Weight of each round."""
    method: TruncatedNewton = field(default_factory=lambda: TruncatedNewton(max_steps=5))
    """Settings of the solver."""


def run(config: Experiment) -> Report:
    """Deform every surface, then take one round apart."""
    torch.set_num_threads(1)
    scene = Scene.of(config.nodes, config.size)
    measured = torch.tensor([_surface(scene, config, seed) for seed in range(config.surfaces)])
    middle = measured.median(0).values  # rounds, columns
    rows = tuple(
        (f"{number + 1}, w_arap {weight:g}", *numbers)
        for number, (weight, numbers) in enumerate(
            zip(config.rigidity, middle.tolist(), strict=True)
        )
    )
    title = f"{len(scene.graph)} nodes, {len(scene.graph.edges)} edges: medians of {len(measured)}"
    frames = measured[..., 2:4].sum((-2, -1))
    note = f"CPU ms a frame: median {frames.median():.1f}, worst {frames.max():.1f}"
    return Report((Table(title, _COLUMNS, rows, digits=2), _parts(scene, config)), (note,))


def _surface(scene: Scene, config: Experiment, seed: int) -> list[list[float]]:
    """Numbers of every round of one surface, as ``_COLUMNS`` without the first."""
    target = scene.waves(config.amplitude, seed)
    deformation, rounds = scene.graph.identity(scene.posed), []
    for weight in config.rigidity:
        pairs = scene.match(scene.graph(scene.posed, deformation), target)
        build = partial(scene.objective, pairs, weight, config.stretch)
        objective = build()
        deform = partial(solve, objective, deformation)
        found, best = deform(config.method), float(deform(_STRICT).energy)
        numbers = (
            int((pairs.confidence > 0).sum()),
            int(found.steps),
            _milliseconds(build),
            _milliseconds(partial(deform, config.method)),
            float(objective(deformation)),
            float(found.energy),
            100 * (float(found.energy) / best - 1),
        )
        rounds.append([float(number) for number in numbers])
        deformation = found.state
    return rounds


def _parts(scene: Scene, config: Experiment) -> Table:
    """Times of what a solve is made of, at the first linearization of the first surface."""
    pairs = scene.match(scene.posed, scene.waves(config.amplitude, 0))
    state = scene.graph.identity(scene.posed)
    objective = scene.objective(pairs, config.rigidity[0], config.stretch)
    problem = SparseProblem.of(objective, state)
    with torch.no_grad():
        equations = problem.linearize(state)
        damping = config.method.damping * equations.diagonal.diagonal(dim1=-2, dim2=-1)
        space = problem.coarse_space(state)
        assert space is not None
        correct = partial(coarse_correction, space, equations, damping)
        contour, rigidity = problem.energies.values()
        assert isinstance(contour, ContourAlignment) and isinstance(rigidity, Rigidity)
        parts: list[tuple[str, Callable[[], object]]] = [
            ("energies", partial(problem.evaluate, state)),
            ("linearization", partial(problem.linearize, state)),
            ("of the contour", partial(contour.linearize_blocks, state)),
            ("of the rigidity", partial(rigidity.linearize_blocks, state)),
            ("coarse correction", correct),
        ]
        rows: list[tuple[object, ...]] = [(name, "", _milliseconds(of)) for name, of in parts]
        on, none = torch.ones(1, dtype=torch.bool), torch.zeros_like(equations.energy)
        for name, coarse in (("with it", correct()), ("without", None)):
            for share in (config.method.forcing, 1e-3):
                search = partial(
                    conjugate_gradients, equations, damping, on, none, share, 1000, coarse
                )
                rounds = int(search().rounds)
                rows.append((f"a step to {share:g}, {name}", rounds, _milliseconds(search)))
    return Table("parts of a solve", ("part", "rounds", "CPU ms"), tuple(rows), digits=2)


def _milliseconds(function: Callable[[], object]) -> float:
    """Least CPU time of several calls."""
    best = float("inf")
    for _ in range(_REPEATS):
        start = time.thread_time()
        function()
        best = min(best, time.thread_time() - start)
    return 1e3 * best


if __name__ == "__main__":
    report.main(run, Experiment, "deformation_speed")
