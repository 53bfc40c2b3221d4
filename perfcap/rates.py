"""Frames a second, as callers give them."""

from __future__ import annotations

import math
from typing import Any, Protocol

from perfcap.errors import InputError

SLOWEST, FASTEST = 0.01, 1e5
"""Frames a second, from and to: what videos can say."""


_SLOW = 0.2
"""Frames a second: who is seen every five seconds only has no motion to speak of."""

_FAST = 1000.0
"""Frames a second: people move too slowly for more to be recorded of them."""


class Timed(Protocol):
    """Something that runs at so many frames a second; a ``Clip``."""

    @property
    def fps(self) -> float:
        """Frames a second."""


def frame_rate(value: Any, name: str = "rate") -> float:
    """A number of frames a second: a plain one, a tensor of one, or that of a clip.

    Args:
        value: as it was given.
        name: of the argument.

    Raises:
        InputError: it is none, or slower or faster than any video.
    """
    value = getattr(value, "fps", value)
    try:
        rate = math.nan if isinstance(value, str | bytes | bool) else float(value)
    except (TypeError, ValueError, RuntimeError):  # the last: a tensor of several
        rate = math.nan
    if not SLOWEST <= rate < FASTEST:
        raise InputError(
            f"{name} is {value!r:.80}, expected frames a second, one number from {SLOWEST:g} to "
            f"{FASTEST:g}"
        )
    return rate


def rate_doubts(rate: float) -> tuple[str, ...]:
    """A sentence where a rate looks like the seconds of a frame, or is of no recording of people.

    Args:
        rate: frames a second.
    """
    if rate > _FAST:
        return (
            f"rate is {rate:.4g} frames a second, at which people are not recorded; check its unit "
            "(30 or 60 for most videos)",
        )
    if rate >= _SLOW:
        return ()
    return (
        f"rate is {rate:.4g} frames a second, a frame in {1 / rate:.4g} s; if a frame takes "
        f"{rate:.4g} s, give {1 / rate:.4g}",
    )
