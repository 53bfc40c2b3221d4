"""Whether the numbers of a configuration can be what they are called, by name."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import lru_cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Literal, TypeGuard, Union, get_args, get_origin, get_type_hints

from perfcap.errors import InputError

_LONGEST = 1.0  # metres, of deviations of points of a body


class Settings:
    """Base of frozen dataclasses of settings: every field is what its annotation says.

    Numbers are not NaN, and not below zero where their default is not; parts are of their kind;
    tensors may stand for numbers, as weights that are learned.

    Raises:
        InputError: one is something else; it is named.
    """

    def __post_init__(self) -> None:
        kinds = _kinds(type(self))  # type: ignore[arg-type]  # a class can be hashed
        for name, (kind, least) in kinds.items():
            value = getattr(self, name)
            if not _fits(kind, value, least):
                raise InputError(
                    f"{name} of {type(self).__name__} is {value!r:.80}, expected "
                    f"{_described(kind, least)}"
                )


@lru_cache
def _kinds(settings: type) -> dict[str, tuple[Any, float]]:
    """What each field is, and the least number that it may be."""
    hints = get_type_hints(settings)
    found = {}
    for field in fields(settings):
        below = isinstance(field.default, Real) and field.default < 0
        known = field.default is not MISSING and below
        found[field.name] = hints[field.name], -math.inf if known else 0.0
    return found


def _fits(kind: Any, value: object, least: float) -> bool:
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return any(_fits(each, value, least) for each in inner)
    if origin is Literal:
        return value in inner
    if origin is tuple:
        return isinstance(value, tuple | list) and _each_fits(inner, value, least)
    if kind is bool:
        return isinstance(value, bool)
    if kind in (int, float):
        if _is_tensor(value):
            return kind is float
        known = isinstance(value, Integral if kind is int else Real)
        return known and not isinstance(value, bool) and float(value) >= least  # type: ignore[arg-type]
    if isinstance(kind, type) and (kind is NoneType or kind is str or is_dataclass(kind)):
        return isinstance(value, kind)
    return True


def _each_fits(kinds: tuple[Any, ...], values: Sequence[object], least: float) -> bool:
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        return all(_fits(kinds[0], value, least) for value in values)
    pairs = zip(kinds, values, strict=False)
    return len(kinds) == len(values) and all(_fits(kind, value, least) for kind, value in pairs)


def _described(kind: Any, least: float) -> str:
    above = "" if math.isinf(least) else f" of {least:g} or more"
    simple = {int: f"a whole number{above}", float: f"a number{above}", bool: "True or False"}
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(_described(each, least) for each in get_args(kind))
    if kind is NoneType:
        return "None"
    if get_origin(kind) is Literal:
        *most, last = map(str, get_args(kind))
        return f"{', '.join(most)} or {last}"
    if kind in simple:
        return simple[kind]
    if get_origin(kind) is tuple:
        inner = get_args(kind)
        count = "numbers" if inner[-1] is Ellipsis else f"{len(inner)} numbers"
        return f"a tuple of {count}{above}"
    return getattr(kind, "__name__", str(kind))


# --- Arguments, one at a time ---------------------------------------------------------------------


def require_count(count: object, name: str, least: int = 1) -> None:
    """Refuse what is no whole number of ``least`` or more.

    Raises:
        InputError: ``name`` is none.
    """
    if not isinstance(count, Integral) or isinstance(count, bool) or int(count) < least:
        raise InputError(f"{name} is {count!r:.80}, expected a whole number of {least} or more")


def require_size(size: object, name: str, *, finite: bool = False) -> None:
    """Refuse what is no number above zero.

    Raises:
        InputError: ``name`` is none.
    """
    if not _number(size) or not size > 0 or (finite and math.isinf(size)):
        raise InputError(f"{name} is {size!r:.80}, expected a number above zero")


def require_number(value: object, name: str, least: float = -math.inf) -> None:
    """Refuse what is no finite number of ``least`` or more.

    Raises:
        InputError: ``name`` is none.
    """
    if not _number(value) or not math.isfinite(value) or value < least:
        above = "" if math.isinf(least) else f" of {least:g} or more"
        raise InputError(f"{name} is {value!r:.80}, expected a finite number{above}")


def require_range(
    name: str, given: tuple[float, float], limits: tuple[float, float], what: str
) -> None:
    """Refuse what is not from one number to a larger one, within limits: it has another unit.

    Raises:
        InputError: it is not.
    """
    low, high = given
    if not limits[0] <= low <= high <= limits[1]:
        raise InputError(
            f"{name}: is {low} {high}; expected FROM TO, {what}, from {limits[0]:g} to "
            f"{limits[1]:g}"
        )


def require_elevation(name: str, elevation: tuple[float, float]) -> None:
    """Refuse a mean and a deviation of cameras above people, degrees, that are none.

    Raises:
        InputError: they are none.
    """
    mean, deviation = elevation
    if not (-90 <= mean <= 90 and 0 <= deviation <= 90):
        raise InputError(
            f"{name}: is {mean} {deviation}; expected MEAN DEVIATION in degrees, from -90 to 90 "
            "and from 0 to 90"
        )


# --- What no annotation of settings says ----------------------------------------------------------


def require_counts(settings: Any, *names: str, least: int = 1) -> None:
    """Refuse fields that are no whole numbers of ``least`` or more.

    Raises:
        InputError: one is none.
    """
    for name in names:
        require_count(getattr(settings, name), _named(settings, name), least)


def require_sizes(settings: Any, *names: str, finite: bool = False) -> None:
    """Refuse fields that are no numbers above zero: residuals are divided by them.

    Infinite ones switch a term off, where they need not be ``finite``.

    Raises:
        InputError: one is none.
    """
    for name in names:
        require_size(getattr(settings, name), _named(settings, name), finite=finite)


def require_amounts(settings: Any, *names: str) -> None:
    """Refuse fields that are no finite numbers of zero or more: what is infinite times zero is
    none.

    Raises:
        InputError: one is none.
    """
    for name in names:
        require_number(getattr(settings, name), _named(settings, name), least=0.0)


def require_metres(settings: Any, *names: str, zero: bool = False) -> None:
    """Refuse fields that are no lengths of parts of a body, or tuples of such: above zero, or
    from ``zero`` on.

    Infinite ones switch a term off; finite ones above a metre are of another unit.

    Raises:
        InputError: one is none.
    """
    _require_unit(settings, names, _LONGEST, "metres", zero)


def require_radians(settings: Any, *names: str) -> None:
    """Refuse fields that are no angles above zero: finite ones above a turn are degrees.

    Raises:
        InputError: one is none.
    """
    _require_unit(settings, names, math.tau, "radians")


def _require_unit(
    settings: Any, names: Sequence[str], most: float, unit: str, zero: bool = False
) -> None:
    for name in names:
        value = getattr(settings, name)
        for one in value if isinstance(value, tuple | list) else (value,):
            known = _number(one) and (one > 0 or (zero and one == 0))
            if not known or most < one < math.inf:
                least = "zero or above" if zero else "above zero"
                raise InputError(
                    f"{_named(settings, name)} is {value!r:.80}, expected {unit}: {least}, at most "
                    f"{most:.3g}, or inf, which switches it off"
                )


def require_shares(settings: Any, *names: str, most: float = 1.0) -> None:
    """Refuse fields that are not from 0 to ``most``.

    Raises:
        InputError: one is not.
    """
    for name in names:
        share = getattr(settings, name)
        if not _number(share) or not 0 <= share <= most:
            limit = "zero or above" if math.isinf(most) else f"from 0 to {most:g}"
            raise InputError(f"{_named(settings, name)} is {share!r}, expected a number {limit}")


def _is_tensor(value: object) -> bool:
    """Without loading torch, which the command line's help does without."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, torch.Tensor)


def _number(value: object) -> TypeGuard[float]:
    return isinstance(value, Real) and not isinstance(value, bool)


def _named(settings: Any, name: str) -> str:
    return f"{name} of {type(settings).__name__}"
