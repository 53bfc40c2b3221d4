"""Stretches of a clip that somebody should look at."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

_SPANS: tuple[tuple[tuple[str, ...], str, str], ...] = (
    (("not_captured",), "bad", "not captured"),
    (("refinement", "pose", "not_refined"), "odd", "motion not refined"),
    (("refinement", "surface", "not_refined"), "odd", "surface not refined"),
)
_FRAMES: tuple[tuple[tuple[str, ...], str, str], ...] = (
    (("refinement", "scene_cuts"), "note", "scene cut"),
    (("refinement", "nobody_in_view"), "bad", "nobody in view"),
    (("refinement", "no_contour"), "odd", "no outline"),
    (("refinement", "blank_images"), "odd", "image of one color"),
    (("refinement", "doubtful_masks"), "odd", "doubtful mask"),
    (("refinement", "cropped"), "note", "cut off by the border of an image"),
)
_MOST = 200  # marks of a kind
_LONGEST = 200  # letters of a reason


@dataclass(frozen=True)
class Mark:
    """Frames of the video, ``start`` to ``stop`` (exclusive), and why they stand out.

    ``kind`` is ``bad`` where a frame is made up, ``odd`` where it is less than it could be, and
    ``note`` otherwise.
    """

    start: int
    stop: int
    kind: str
    text: str

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def marks(report: Mapping[str, Any], first: int, stop: int) -> list[Mark]:
    """Marks within frames ``first`` to ``stop`` that a ``run.json`` speaks of."""
    found: list[Mark] = []
    for keys, kind, text in _SPANS:
        spans = _pairs(_value(report, keys))
        found += _within(spans, first, stop, kind, text)
    for keys, kind, text in _FRAMES:
        value = _value(report, keys)
        numbers = [n for n in value if _is_index(n)] if isinstance(value, list) else []
        found += _within(_runs(numbers), first, stop, kind, text)
    return found + _not_trusted(report, first, stop)


def _not_trusted(report: Mapping[str, Any], first: int, stop: int) -> list[Mark]:
    """What ``Trust.report`` says of the frames, each stretch with its own reason."""
    stretches = _value(report, ("quality", "not_trusted"))
    found: list[Mark] = []
    for stretch in (stretches if isinstance(stretches, list) else [])[:_MOST]:
        span, reason = (_value({"of": stretch}, ("of", key)) for key in ("frames", "reason"))
        why = f": {reason[:_LONGEST]}" if isinstance(reason, str) else ""
        found += _within(_pairs([span]), first, stop, "odd", f"not to be trusted{why}")
    return found


def _within(
    spans: Iterable[tuple[int, int]], first: int, stop: int, kind: str, text: str
) -> list[Mark]:
    cut = ((max(a, first), min(b, stop)) for a, b in spans)
    return [Mark(a, b, kind, text) for a, b in cut if a < b][:_MOST]


def _pairs(value: Any) -> Iterator[tuple[int, int]]:
    for pair in value if isinstance(value, list) else []:
        if isinstance(pair, list) and len(pair) == 2 and all(map(_is_index, pair)):
            yield pair[0], pair[1]


def _runs(numbers: list[int]) -> Iterator[tuple[int, int]]:
    """Consecutive numbers as half-open ranges."""
    found: list[list[int]] = []
    for number in numbers:
        if not found or found[-1][1] != number:
            found.append([number, number])
        found[-1][1] = number + 1
    return ((start, stop) for start, stop in found)


def _value(report: Mapping[str, Any], keys: tuple[str, ...]) -> Any:
    value: Any = report
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _is_index(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**53
