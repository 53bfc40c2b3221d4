"""CPU time of one bounded pose window to 0.1 % of its best energy (Xu et al. 2018, Eq. 2 and 3).

33 unknowns x 50 frames, the paper's weights, its temporal subspace of 8 cosines and anatomical
limits, one camera, noisy 2D and 3D joints. Every method starts from ``initialize``. The best
energy of a window is the lowest that any method found. One thread; process CPU time, which other
programs on the same cores still lengthen: compare rows of one run.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import report
import torch
from detection_noise import detect
from report import Report, Table
from solver_peers import Trace, ceres_trace, dense_trace, scipy_trace
from window_problem import Problem, gaussian, windows

from perfcap.pipeline.config import MONOPERFCAP_POSE
from perfcap.solve import Adam, LevenbergMarquardt, Method, solve

_GENEROUS = 300  # steps
_ADAM = (100, 300, 1000)  # steps; its schedule depends on how many there are
_REPEATS = 3
_COLUMNS = ("method", "reached", "CPU ms, median", "worst", "steps, median", "ms a step", "above")


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    noise: Literal["gaussian", "detector"] = "gaussian"
    """Independent errors, or a simulated detector with swaps, outliers and depth flips."""
    windows: int = 8
    """Windows, each of another motion."""
    slow: int = 1
    """Windows for the peers that take seconds a step; 0 leaves them out."""
    enough: float = 1e-3
    """Relative distance to the best energy that counts as reached."""
    seed: int = 0
    """Of headings and noise."""


@dataclass(frozen=True)
class Fate:
    """How a method fared on a window: steps and CPU seconds to the target, None if not reached."""

    lowest: float
    reached: tuple[int, float] | None


def run(config: Experiment) -> Report:
    """Run every method on every window."""
    torch.set_num_threads(1)
    detector = gaussian if config.noise == "gaussian" else detect
    sequences = windows(config.windows, seed=config.seed, detector=detector)
    problems = [Problem.of(sequence, MONOPERFCAP_POSE) for sequence in sequences]
    peers, notes = _peer_traces(problems[: config.slow])
    best = [_best(problem) for problem in problems]
    for traces in peers.values():
        lowest = (min(energy for _, energy in trace) for trace in traces)
        best[: config.slow] = map(min, best, lowest)
    targets = [(1 + config.enough) * energy for energy in best]
    singles = [problem.single() for problem in problems]
    fates = {
        "perfcap, float64": list(map(_levenberg, problems, targets)),
        "perfcap, float32": list(map(_levenberg, singles, targets)),
        "perfcap Adam": list(map(_adam, problems, targets)),
    }
    for name, traces in peers.items():
        fates[name] = [_from_trace(*pair) for pair in zip(traces, targets, strict=False)]
    rows = tuple(_row(name, found, best) for name, found in fates.items())
    title = (
        f"{config.noise} noise, {len(problems)} windows: to {100 * config.enough:g} % of the best"
    )
    each = [
        f"{s.name} {f.reached}" for s, f in zip(sequences, fates["perfcap, float64"], strict=True)
    ]
    return Report(
        (Table(title, _COLUMNS, rows),),
        ("perfcap, float64, (steps, CPU s): " + ", ".join(each), *notes),
    )


def _best(problem: Problem) -> float:
    """Lowest energy of three generous runs that start with other dampings."""
    methods = (LevenbergMarquardt(_GENEROUS, 1e-12, damping=d) for d in (1e-3, 0.1, 10.0))
    return min(_timed(problem, method)[0] for method in methods)


def _levenberg(problem: Problem, target: float) -> Fate:
    """Fewest steps to the target, by bisection: the energy falls with every step."""
    budget: Callable[[int], Method] = partial(LevenbergMarquardt, tolerance=1e-9)
    lowest, _ = _timed(problem, budget(_GENEROUS))
    if lowest > target:
        return Fate(lowest, None)
    low, high = 0, _GENEROUS
    while high - low > 1:
        middle = (low + high) // 2
        enough = _timed(problem, budget(middle))[0] <= target
        low, high = (low, middle) if enough else (middle, high)
    seconds = min(_timed(problem, budget(high))[1] for _ in range(_REPEATS))
    return Fate(lowest, (high, seconds))


def _adam(problem: Problem, target: float) -> Fate:
    lowest = float("inf")
    for steps in _ADAM:
        energy, seconds = _timed(problem, Adam(steps))
        lowest = min(lowest, energy)
        if energy <= target:
            return Fate(lowest, (steps, seconds))
    return Fate(lowest, None)


def _timed(problem: Problem, method: Method) -> tuple[float, float]:
    """Energy that a method ends at and its CPU seconds."""
    start = time.process_time()
    solution = solve(problem.objective, problem.initial, method, problem.bounds)
    seconds = time.process_time() - start
    return float(solution.energy), seconds


def _peer_traces(problems: list[Problem]) -> tuple[dict[str, list[Trace]], list[str]]:
    """Traces of the slow peers, and why one was left out."""
    peers: dict[str, list[Trace]] = {}
    notes = []
    for name, trace in (
        ("Ceres DENSE_SCHUR, native bounds", ceres_trace),
        ("SciPy trf", scipy_trace),
        ("perfcap without structure", dense_trace),
    ):
        try:
            peers[name] = [trace(problem) for problem in problems]
        except ImportError as error:
            notes.append(f"{name}: left out, {error}")
    return {name: traces for name, traces in peers.items() if traces}, notes


def _from_trace(trace: Trace, target: float) -> Fate:
    hits = ((step, seconds) for step, (seconds, energy) in enumerate(trace) if energy <= target)
    return Fate(min(energy for _, energy in trace), next(hits, None))


def _row(name: str, fates: list[Fate], best: list[float]) -> tuple[object, ...]:
    """``above`` is the median distance to the best energy in the end, percent."""
    above = 100 * statistics.median(f.lowest / b - 1 for f, b in zip(fates, best, strict=False))
    hits = [fate.reached for fate in fates if fate.reached is not None]
    reached = f"{len(hits)}/{len(fates)}"
    if not hits:
        return name, reached, "-", "-", "-", "-", above
    milliseconds = [1e3 * seconds for _, seconds in hits]
    steps = [step for step, _ in hits]
    each = statistics.median(m / max(1, s) for m, s in zip(milliseconds, steps, strict=True))
    median = statistics.median(milliseconds)
    return name, reached, median, max(milliseconds), statistics.median(steps), each, above


if __name__ == "__main__":
    report.main(run, Experiment, "solver_speed")
