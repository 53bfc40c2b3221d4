"""Gradients through one bounded pose window: what they cost, and how exact they are.

A window of 50 frames of the default objective (2D and 3D joints, trajectory, prior, limits), solved
by Levenberg-Marquardt and differentiated in all 2D joints, 3D joints, confidences, the camera and
the bones at once. One thread; process CPU time. Exactness is measured against central differences
of windows solved anew, along random directions, extrapolated from two steps to none.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import report
import torch
from report import Report, Table
from torch import Tensor
from window_problem import Problem, Sequence, gaussian, windows

from perfcap.actor.motion import Motion
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.objective import pose_objective, trajectory_prior
from perfcap.solve import (
    Adjoint,
    Detached,
    Implicit,
    LevenbergMarquardt,
    Objective,
    Sensitivity,
    Unrolled,
    solve,
)
from perfcap.solve.assembly import assemble
from perfcap.solve.implicit_step import free_unknowns, invert
from perfcap.solve.layout import Layout
from perfcap.solve.stationarity import hessian

_ADJOINTS: dict[str, Adjoint] = {
    "Implicit, full Hessian": Implicit(),
    "Implicit, Gauss-Newton": Implicit("gauss_newton"),
    "Unrolled, 1 step": Unrolled(1),
    "Unrolled, 5 steps": Unrolled(5),
}
_INPUTS = ("joints2d", "joints3d", "confidence2d", "camera", "bones")
_TIGHT, _NEWTON = LevenbergMarquardt(1000, 1e-13), 4
_COST = (
    "gradient", "solve", "with gradient recorded", "backward", "extra / solve", "backward / solve",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    windows: int = 4
    """Windows, each of another motion."""
    tolerance: float = 1e-3
    """Relative decrease of the energy that ends a solve whose cost is measured."""
    repeats: int = 5
    """Of each measurement; the least counts."""
    directions: int = 4
    """In which exactness is measured, for each kind of input of each window."""
    size: float = 1e-3
    """Of the central differences, relative to the noise of the input."""
    seed: int = 0
    """Of headings, noise and directions."""


@dataclass(frozen=True)
class Inputs:
    """What a window is made of, and what gradients are taken in."""

    joints2d: Tensor
    joints3d: Tensor
    confidence2d: Tensor
    camera: Tensor
    bones: Tensor

    @classmethod
    def of(cls, sequence: Sequence) -> Inputs:
        """Those of a window."""
        seen = sequence.detections
        assert seen.joints3d is not None
        bones = sequence.actor.skeleton.tree.bone_vectors
        return cls(
            seen.joints2d, seen.joints3d, seen.confidence2d, sequence.cameras.translation, bones
        )

    def scales(self) -> dict[str, float]:
        """How much of each is noise: pixels, metres, shares, metres, metres."""
        return dict(zip(_INPUTS, (3.0, 0.03, 0.1, 0.02, 0.005), strict=True))


def run(config: Experiment) -> Report:
    """Measure cost and exactness on every window."""
    torch.set_num_threads(1)
    problems = [
        Problem.of(sequence, PoseConfig(clean=0.0))
        for sequence in windows(config.windows, seed=config.seed, detector=gaussian)
    ]
    costs = [_cost_row(name, problems, config) for name in _ADJOINTS]
    title = f"CPU ms of a window solved to {config.tolerance:g}, median of {len(problems)} windows"
    errors, notes = _errors(problems, config)
    return Report(
        (
            Table(title, _COST, tuple(costs), 2),
            Table(
                "relative error of directional derivatives, median and worst",
                ("input", "full Hessian", "worst", "Gauss-Newton", "worst "),
                tuple(errors),
                7,
            ),
        ),
        notes,
    )


def _objective(problem: Problem, inputs: Inputs) -> Objective:
    """The window's objective made of other inputs."""
    sequence, config = problem.sequence, problem.config
    actor = sequence.actor
    actor.skeleton.tree.bone_vectors = inputs.bones
    detections = replace(
        sequence.detections,
        joints2d=inputs.joints2d,
        joints3d=inputs.joints3d,
        confidence2d=inputs.confidence2d,
    )
    cameras = replace(sequence.cameras, translation=inputs.camera)
    prior = trajectory_prior(config.trajectory, detections.frame_count, 30.0)
    return pose_objective(actor, cameras, detections, config, problem.unit, prior)


def _loss(state: Motion, seed: int = 0) -> Tensor:
    """A random linear function of the motion."""
    random = torch.Generator().manual_seed(seed)
    parts = (state.translation, state.rotation, state.angles)
    weighted = [(x * torch.randn(x.shape, generator=random, dtype=x.dtype)).sum() for x in parts]
    return torch.stack(weighted).sum()


def _cost_row(name: str, problems: list[Problem], config: Experiment) -> tuple[object, ...]:
    method = LevenbergMarquardt(100, config.tolerance)
    rows = [_costs(problem, _ADJOINTS[name], method, config.repeats) for problem in problems]
    plain, recorded, backward = (1e3 * statistics.median(row[i] for row in rows) for i in range(3))
    extra = statistics.median((row[1] - row[0] + row[2]) / row[0] for row in rows)
    alone = statistics.median(row[2] / row[0] for row in rows)
    return name, plain, recorded, backward, extra, alone


def _costs(
    problem: Problem, adjoint: Adjoint, method: LevenbergMarquardt, repeats: int
) -> tuple[float, float, float]:
    """CPU seconds of a plain solve, of one that records its gradient, and of its backward pass."""
    known = Inputs.of(problem.sequence)

    def plain() -> None:
        solve(_objective(problem, known), problem.initial, method, problem.bounds, Detached())

    def recorded() -> tuple[float, float]:
        leaves = Inputs(*(getattr(known, name).clone().requires_grad_() for name in _INPUTS))
        start = time.process_time()
        found = solve(_objective(problem, leaves), problem.initial, method, problem.bounds, adjoint)
        middle = time.process_time()
        torch.autograd.grad(_loss(found.state), [getattr(leaves, name) for name in _INPUTS])
        return middle - start, time.process_time() - middle

    alone = min(_timed(plain) for _ in range(repeats))
    pairs = [recorded() for _ in range(repeats)]
    problem.sequence.actor.skeleton.tree.bone_vectors = known.bones
    return alone, min(pair[0] for pair in pairs), min(pair[1] for pair in pairs)


def _timed(action: Callable[[], None]) -> float:
    start = time.process_time()
    action()
    return time.process_time() - start


def _errors(
    problems: list[Problem], config: Experiment
) -> tuple[list[tuple[object, ...]], tuple[str, ...]]:
    """Relative errors of both Hessians in each kind of input."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in _INPUTS}
    skipped = 0
    for problem in problems:
        start = _minimum(problem, problem.objective, problem.initial)
        known = Inputs.of(problem.sequence)
        slopes = [_slopes(problem, known, start, Implicit(kind)) for kind in _KINDS]
        for name in _INPUTS:
            for seed in range(config.directions):
                move = _direction(known, name, config.seed + seed)
                ends = [
                    _difference(problem, known, start, name, share * config.size * move)
                    for share in (1.0, 0.5)
                ]
                if not all(steady for _, steady in ends):
                    skipped += 1
                    continue
                # without the part that grows with the square of the step (Richardson 1911)
                expected = (8 * ends[1][0] - ends[0][0]) / 3
                along = [float((slope[name] * config.size * move).sum()) for slope in slopes]
                first, second = (abs(one / expected - 1) for one in along)
                found[name].append((first, second))
        problem.sequence.actor.skeleton.tree.bone_vectors = known.bones
    rows: list[tuple[object, ...]] = []
    for name, pairs in found.items():
        columns = list(zip(*pairs, strict=True))
        rows.append((name, *(x for each in columns for x in (statistics.median(each), max(each)))))
    note = (
        f"{skipped} of {len(problems) * len(_INPUTS) * config.directions} directions are left out: "
        "a bound begins or ends to act within the difference"
    )
    return rows, (note,)


_KINDS: tuple[Literal["full", "gauss_newton"], ...] = ("full", "gauss_newton")


def _slopes(problem: Problem, known: Inputs, start: Motion, adjoint: Implicit) -> dict[str, Tensor]:
    leaves = Inputs(*(getattr(known, name).clone().requires_grad_() for name in _INPUTS))
    here = LevenbergMarquardt(0)
    found = solve(_objective(problem, leaves), start, here, problem.bounds, adjoint)
    assert found.sensitivity is not None
    wanted = Sensitivity.EXACT if adjoint.hessian == "full" else Sensitivity.GAUSS_NEWTON
    assert int(found.sensitivity) == wanted
    slopes = torch.autograd.grad(_loss(found.state), [getattr(leaves, name) for name in _INPUTS])
    return dict(zip(_INPUTS, slopes, strict=True))


@torch.no_grad()
def _minimum(problem: Problem, objective: Objective, start: Motion) -> Motion:
    """To the last digit, by Newton steps on the coordinates that bounds leave free."""
    state = solve(objective, start, _TIGHT, problem.bounds).state
    layout = Layout.of(state)
    for _ in range(_NEWTON):
        equations = assemble(objective, state)
        slope = equations.gradient()
        free = free_unknowns(state, problem.bounds, slope, layout)
        good = torch.ones_like(free[:, 0], dtype=torch.bool)
        inverse = invert(hessian(objective, state, equations), equations, free, good)
        state = state.retract(layout.unflatten(-inverse.solve(slope)))
    return state


def _direction(known: Inputs, name: str, seed: int) -> Tensor:
    """Noise of the size that the input has."""
    random = torch.Generator().manual_seed(seed)
    value = getattr(known, name)
    move = known.scales()[name] * torch.randn(value.shape, generator=random, dtype=value.dtype)
    if name == "bones":
        move[0] = 0  # the root has none
    return move


def _difference(
    problem: Problem, known: Inputs, start: Motion, name: str, move: Tensor
) -> tuple[float, bool]:
    """Half the difference of the loss at both ends, and whether the same bounds act there."""
    lower, upper = problem.bounds.lower.frame, problem.bounds.upper.frame
    losses, acting = [], []
    for sign in (1, -1):
        moved = replace(known, **{name: getattr(known, name) + sign * move})
        state = _minimum(problem, _objective(problem, moved), start)
        here = state.coordinates().frame
        losses.append(float(_loss(state)))
        acting.append((here <= lower) | (here >= upper))
    return (losses[0] - losses[1]) / 2, bool((acting[0] == acting[1]).all())


if __name__ == "__main__":
    report.main(run, Experiment, "adjoint_speed")
