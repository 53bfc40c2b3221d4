"""Whether frames of one number in several videos were taken at one time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_APART = 0.5  # frames: views that are farther apart match the wrong frames
_LASTING = 5  # frames in which they are, of views that end alike: single times may be odd


def parting(timed: Sequence[tuple[Array, str]]) -> list[str]:
    """That they were not, in words.

    Times decide, not rates: those of one camera's files are rounded differently.

    Args:
        timed: times of the frames from the first, (F,), seconds, and the name of each view.
    """
    ends = [(float(times[-1]), name) for times, name in timed if times[-1] > 0]
    if len(ends) < 2:
        return []
    (fast, fast_name), (slow, slow_name) = min(ends), max(ends)
    last = len(timed[0][0]) - 1
    rate = last / fast
    apart = (slow - fast) * rate
    if apart <= _APART:
        return _parting_between(timed)
    return [
        f"videos run at different rates ({fast_name} {rate:.5g}, {slow_name} {last / slow:.5g} "
        f"frames a second): in frame {last} they are {apart:.1f} frames apart, which no constant "
        f"shift mends; convert them to one rate (ffmpeg -i IN -vf fps={rate:.5g} OUT), unless one "
        "trigger took their frames"
    ]


def _parting_between(timed: Sequence[tuple[Array, str]]) -> list[str]:
    """The same of views that end alike: each left out frames, at another time."""
    times = np.stack([each for each, _ in timed])
    step = float(np.median(np.diff(times)))
    if step <= 0:  # most frames of a file have the time of the one before
        return []
    rate = 1 / step
    apart = np.ptp(times, axis=0) * rate
    if int((apart > _APART).sum()) < _LASTING:
        return []
    frame = int(apart.argmax())
    early, late = (timed[int(at(times[:, frame]))][1] for at in (np.argmin, np.argmax))
    return [
        f"videos leave out frames at different times: in frame {frame} {early} and {late} are "
        f"{apart[frame]:.1f} frames apart; convert them to one rate (ffmpeg -i IN -vf "
        f"fps={rate:.5g} OUT), unless one trigger took their frames"
    ]
