"""Classical least-squares problems: answers right to six digits, and claims that do not hold.

The problems of Moré, Garbow and Hillstrom (1981), boxes around them, and, where a folder of their
files is given, NIST's nonlinear regressions from both starts. Wrong: the energy (regressions: the
parameters) differs from the known one in the sixth digit. False: the method claims convergence,
and the cosine between the residual and a column of the Jacobian that is free to move is above
0.002; an unknown within a millionth of its bound counts as on it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import report
import torch
from classical_problems import Classic, bounded, unbounded
from nist_fits import Fit, read_fits
from report import Report, Table
from scipy.optimize import least_squares
from torch import Tensor

from perfcap.solve import LevenbergMarquardt, Status, solve

_COLUMNS = ("method", "problems", "right", "false claims", "steps", "CPU s")
_SIX, _FAR = 1e-6, 2e-3
Answer = tuple[Tensor, bool, int]  # unknowns, whether convergence is claimed, steps


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    nist: Path | None = None
    """Folder of NIST's files, ``Misra1a.dat`` and so on."""


@dataclass(frozen=True)
class Task:
    """A problem and a judge of its answers."""

    problem: Classic
    right: Callable[[Tensor], bool]


METHODS = {
    "perfcap, last digit": LevenbergMarquardt(1000, 0, 1e-2),
    "perfcap, default": LevenbergMarquardt(),
    "perfcap, default, 300 steps": LevenbergMarquardt(300),
    "perfcap, heavily damped": LevenbergMarquardt(300, damping=1e6),
}


def run(config: Experiment) -> Report:
    """Run every method on every collection."""
    torch.set_num_threads(1)
    free, held = map(_classics, (unbounded(), bounded()))
    fits = read_fits(config.nist) if config.nist else []
    regressions = [_regression(fit, start) for fit in fits for start in fit.starts]
    sets = {"Moré, Garbow, Hillstrom": free, "in boxes": held, "regressions": regressions}
    tables, notes = [], []
    for title, tasks in sets.items():
        if not tasks:
            notes.append(f"{title}: left out, give --nist FOLDER")
            continue
        rows = [_row(name, tasks, _perfcap(method), notes) for name, method in METHODS.items()]
        scipy = "SciPy trf" if title == "in boxes" else "MINPACK lmder"
        rows.append(_row(scipy, tasks, _scipy, notes))
        tables.append(Table(title, _COLUMNS, tuple(rows)))
    return Report(tuple(tables), tuple(notes))


def _classics(problems: list[Classic]) -> list[Task]:
    return [Task(problem, partial(_reaches, problem)) for problem in problems]


def _reaches(problem: Classic, x: Tensor) -> bool:
    energy = float(problem.residual(x).square().sum())
    gone = 0 in problem.minima and _gone(problem, energy)
    return gone or any(abs(energy - least) <= _SIX * least for least in problem.minima)


def _gone(problem: Classic, energy: float) -> bool:
    """Whether all but rounding of the residuals is gone."""
    return energy <= 1e-20 * float(problem.residual(problem.initial()).square().sum())


def _regression(fit: Fit, start: Tensor) -> Task:
    problem = Classic(fit.name, fit.residual, tuple(start.tolist()), ())
    return Task(problem, lambda x: fit.digits(x) >= 6)


def _perfcap(method: LevenbergMarquardt) -> Callable[[Classic], Answer]:
    def answer(problem: Classic) -> Answer:
        found = solve(problem.residual, problem.initial(), method, problem.bounds())
        return found.state, bool(found.status == Status.CONVERGED), int(found.steps)

    return answer


def _scipy(problem: Classic) -> Answer:
    bounds = problem.bounds()
    start = problem.initial()
    if bounds is not None:  # trf starts inside
        start = start.clamp(bounds[0] + 1e-9, bounds[1] - 1e-9)
    found = least_squares(
        lambda x: problem.residual(torch.from_numpy(x)).numpy(),
        start.numpy(),
        jac=lambda x: torch.func.jacfwd(problem.residual)(torch.from_numpy(x)).numpy(),
        method="lm" if bounds is None else "trf",
        x_scale="jac",
        max_nfev=2000,
        **({} if bounds is None else {"bounds": tuple(side.numpy() for side in bounds)}),
        **dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15),
    )
    return torch.from_numpy(found.x), found.status > 0, found.nfev


def _row(
    name: str, tasks: list[Task], method: Callable[[Classic], Answer], notes: list[str]
) -> tuple[object, ...]:
    began, right, false, steps = time.process_time(), 0, 0, 0
    for task in tasks:
        x, claimed, count = method(task.problem)
        good = task.right(x)
        lie = claimed and _slope(task.problem, x) > _FAR
        right, false, steps = right + good, false + lie, steps + count
        if lie or (not good and name.endswith("last digit")):
            notes.append(f"{name}, {task.problem.name}: {'false claim' if lie else 'wrong'}")
    return name, len(tasks), right, false, steps, time.process_time() - began


def _slope(problem: Classic, x: Tensor) -> float:
    """Largest cosine between the residual and a free column; 0 where the residual is rounding."""
    jacobian, residual = torch.func.jacfwd(problem.residual)(x), problem.residual(x)
    if _gone(problem, float(residual.square().sum())):
        return 0.0
    slope, length = jacobian.mT @ residual, jacobian.norm(dim=0)
    free = length > 0
    if (bounds := problem.bounds()) is not None:
        near = 1e-6 * x.abs().clamp(min=1)  # trf never reaches a bound
        free &= ~((x <= bounds[0] + near) & (slope > 0))
        free &= ~((x >= bounds[1] - near) & (slope < 0))
    cosine = slope.abs() / (length * residual.norm()).clamp(min=1e-300)
    return float(torch.where(free, cosine, 0).max())


if __name__ == "__main__":
    report.main(run, Experiment, "solver_classics")
