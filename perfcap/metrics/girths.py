"""Height and girths against a tailor's, or a scanner's (Rhodin et al. 2016, Table 1)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import median

from perfcap.errors import InputError

_MILLIMETRES = 1000.0
_LARGE = 5.0  # m: no person has such a height or girth, and in centimetres a child's wrist has more


@dataclass(frozen=True)
class GirthErrors:
    """How far measures are off, millimetres.

    Attributes:
        errors: absolute error of each measure that both sides have, by name.
        mean: of these.
        deviation: standard deviation of these.
        missing: measures of the truth that were not estimated.
    """

    errors: Mapping[str, float]
    mean: float
    deviation: float
    missing: tuple[str, ...]


def girth_errors(found: Mapping[str, float], truth: Mapping[str, float]) -> GirthErrors:
    """Compare measures by name, metres; one that is not finite was not estimated.

    ``dataclasses.asdict(perfcap.actor.measurements.measure(template))`` gives them of a template.

    Raises:
        InputError: a measure of the truth is no positive number, or measures are in another unit.
    """
    for name, value in truth.items():
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"true {name} is {value}, expected metres")
    for whose, measures in (("found", found), ("true", truth)):
        known = [measures[name] for name in truth if math.isfinite(measures.get(name, math.nan))]
        if known and median(known) > _LARGE:
            raise InputError(
                f"{whose} measures are about {median(known):.4g}, expected metres; convert them"
            )
    both = {name: found[name] for name in truth if math.isfinite(found.get(name, math.nan))}
    errors = {name: _MILLIMETRES * abs(value - truth[name]) for name, value in both.items()}
    count = len(errors)
    mean = sum(errors.values()) / count if count else math.nan
    spread = sum((error - mean) ** 2 for error in errors.values())
    deviation = math.sqrt(spread / count) if count else math.nan
    return GirthErrors(errors, mean, deviation, tuple(n for n in truth if n not in both))
