"""Whether the closed forms that an author wrote are those of their energy; else it is told."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import torch
from torch import Tensor

from perfcap.solve.assembly import assemble
from perfcap.solve.compound import OfPart, WindowOfPart
from perfcap.solve.energy import Energy, Objective, WindowEnergy, total
from perfcap.solve.layout import Layout
from perfcap.solve.solution import Solution, Status

_HERE = "perfcap."  # closed forms of this library are held to their energies by tests
_OFF = 0.2  # of a slope: less is what an approximation is off, as one that leaves terms out
_VALUE = 1e-3  # of an energy
_NAMES = ("linearize", "add_to_blocks", "linearize_features", "expand")


def warn_of_contradictions(
    objective: Objective, found: Solution[Any], first: Sequence[float]
) -> None:
    """Warn of energies whose closed forms are not those of their values, where a solve stood still.

    Without a slope any state looks like a minimum. Where an element ends as converged with the
    energy that it had, each closed form of another author than this library's is compared, along
    its own slope, with how its energy changes.

    Args:
        objective: the energies.
        found: what a solve came to.
        first: the energies that it began with, B.
    """
    foreign = [each for each in _single(objective, found.state) if _is_foreign(each[1])]
    if not foreign:
        return
    status, ends = (each.reshape(-1).tolist() for each in (found.status, found.energy))
    still = (
        end == Status.CONVERGED and here == start != 0
        for end, here, start in zip(status, ends, first, strict=True)
    )
    if any(still):
        for each in foreign:
            _compare(*each)


def _single(objective: Objective, state: Any) -> Iterator[tuple[str, Energy[Any], Any]]:
    """Name of each energy, the energy of a part itself, and the state that it is of."""
    for name, term in objective.items():
        energy: Energy[Any] = term
        whole = state
        while isinstance(energy, OfPart | WindowOfPart) and energy.name in whole.parts:
            energy, whole = energy.energy, whole.parts[energy.name]
        yield name, energy, whole


def _is_foreign(energy: Energy[Any]) -> bool:
    """Whether its author wrote a closed form that the solver goes by."""
    methods = (getattr(type(energy), name, None) for name in _NAMES)
    return any(m is not None and not m.__module__.startswith(_HERE) for m in methods)


def _compare(name: str, energy: Energy[Any], state: Any) -> None:
    layout = Layout.of(state)
    alone = Objective({"alone": energy})
    equations = assemble(alone, state)
    value, slope = total(equations.terms), 2 * equations.gradient()  # B, B N
    plain = layout.per_element(energy(state))
    if not bool((value.isfinite() & slope.isfinite().all(-1) & plain.isfinite()).all()):
        return
    size = plain.abs() + torch.finfo(plain.dtype).tiny
    if bool(((value - plain).abs() > _VALUE * size).any()):
        _warn(name, energy, f"an energy of {float(value.sum()):.4g} where its", float(plain.sum()))
        return
    step = _direction(slope)
    found, noise = _change(energy, state, layout, step)
    told = (slope * step).sum(-1)
    off = (found - told).abs()
    wrong = off > _OFF * torch.maximum(found.abs(), told.abs()) + noise
    if bool(wrong.any()) and not _reweighted(energy, state, layout, step):
        worst = int((off * wrong).argmax())
        what = f"a slope of {float(told[worst]):.4g} along itself where its"
        _warn(name, energy, what, float(found[worst]))


def _direction(slope: Tensor) -> Tensor:
    """Of length one, along slopes (B, N); in a direction like no other where there is none."""
    odd = (1.0 + torch.arange(slope.shape[-1])).sin().to(slope).expand_as(slope)
    none = (slope == 0).all(-1, keepdim=True)
    return torch.nn.functional.normalize(torch.where(none, odd, slope), dim=-1)


def _moved(state: Any, layout: Layout, step: Tensor, length: float) -> Any:
    return state.retract(layout.unflatten(length * step))


def _length(like: Tensor) -> float:
    return math.pow(torch.finfo(like.dtype).eps, 1 / 3)


def _change(energy: Energy[Any], state: Any, layout: Layout, step: Tensor) -> tuple[Tensor, Tensor]:
    """Derivative of the energy along steps (B, N) by differences, and their rounding, (B,)."""
    length = _length(step)
    high, low = (
        layout.per_element(energy(_moved(state, layout, step, side * length))) for side in (1, -1)
    )
    size, eps = high.abs() + low.abs(), torch.finfo(step.dtype).eps
    noise = 100 * eps * size / length + length**2 * size + math.sqrt(eps) * size.sqrt()
    return (high - low) / (2 * length), noise


def _reweighted(energy: Energy[Any], state: Any, layout: Layout, step: Tensor) -> bool:
    """Whether confidences change along a step, which slopes rightly leave out."""
    if isinstance(energy, WindowEnergy):
        return False
    ends = [energy.residual(_moved(state, layout, step, side * _length(step))) for side in (1, -1)]
    first, last = (end.confidence for end in ends)
    return first is not None and last is not None and not torch.equal(first, last)


def _warn(name: str, energy: Energy[Any], what: str, value: float) -> None:
    warnings.warn(
        f"energy {name!r}: the closed form of {type(energy).__name__} says {what} value says "
        f"{value:.4g}, and the solve ended where it began; compare it with "
        "perfcap.solve.forward_mode(energy, state)",
        stacklevel=2,
    )
