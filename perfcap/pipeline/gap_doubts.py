"""Whether whoever is found after frames that show nobody is the one who was lost before them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from torch import Tensor

_FASTER = 20.0  # m/s2, that hips may be faster or slower by: landings and turns have less for long
_BESIDE = 0.15  # m, beyond that
_WINDOW, _MARGIN = 5, 1  # frames whose way is continued, and those beside a gap that it bends


def gap_doubts(places: Tensor, gaps: Sequence[tuple[int, int]], rate: float) -> Iterator[str]:
    """A sentence about gaps over which a person goes farther than any could in that time.

    The speed of hips before and after a gap is continued through it.

    Args:
        places: of the hips, (F, 3) metres.
        gaps: half-open frame ranges that show nobody.
        rate: frames a second.
    """
    found = [
        (away, start, stop)
        for start, stop in gaps
        if start > 0 and stop < len(places)
        for away, bent in [_beyond(places, start - 1, stop, rate)]
        if away > bent + _BESIDE
    ]
    if found:
        frames = ", ".join(f"{start} to {stop - 1}" for _, start, stop in found)
        away = max(away for away, _, _ in found)
        yield (
            f"after frames {frames} (counted from 0) that show nobody the person is up to "
            f"{away:.2g} m from where they were going; is it somebody else? capture the parts one "
            "at a time (--frames), or everybody (--people auto)"
        )


def _beyond(places: Tensor, last: int, first: int, rate: float) -> tuple[float, float]:
    """How far the first place after a gap is from where the way leads, and may be, metres."""
    before = places[max(0, last - _MARGIN - _WINDOW + 1) : max(1, last - _MARGIN + 1)]
    after = places[first + _MARGIN : first + _MARGIN + _WINDOW]
    steps = [part.diff(dim=0).mean(0) for part in (before, after) if len(part) > 2]
    time = (first - last) / rate
    way = sum(steps, start=0 * places[0]) / max(1, len(steps)) * (first - last)
    return float((places[first] - places[last] - way).norm()), 0.5 * _FASTER * time**2
