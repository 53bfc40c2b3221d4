"""Videos in which pictures are stored more than once, so that the person halts and then leaps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from perfcap.io.clip import Clip
from perfcap.io.doctor.finding import Finding, Severity, of_view, ranges

_FEWEST, _SHARE = 3, 0.05  # frames that repeat the one before, and share of them
_PAUSES = 2  # stretches of a camera that stalled; a converter repeats pictures all the time
_REGULAR = 1  # frames by which distances differ, so that the rest is at one rate
_LONG = 8  # frames of one picture: no network or file has joints of their moments


def examine_halts(clip: object, names: Sequence[str], start: int = 0) -> list[Finding]:
    """Views whose videos show the same picture in frames that follow one another.

    Frames of long stretches are none to be trusted; of others, times are off by a frame or two.

    Args:
        clip: C views; what is no ``Clip`` does not say which frames are the same.
        names: of the views, C.
        start: number of the first frame, as users count.
    """
    if not isinstance(clip, Clip):
        return []
    findings: list[Finding] = []
    for view, name in enumerate(names):
        found = _findings(name, clip.halted(view), clip.fps, start, len(names) == 1)
        findings += of_view(view, found, partly=True)
    return findings


def _findings(
    name: str, halted: NDArray[np.bool_], rate: float, start: int, single: bool
) -> Iterator[Finding]:
    """What is to be said of the frames (F,) of a view that repeat the one before."""
    stretches = list(_stretches(halted))
    held = tuple(f for stretch in stretches if len(stretch) >= _LONG for f in stretch)
    short = [stretch for stretch in stretches if len(stretch) < _LONG]
    if held:
        where = ranges([start + frame for frame in held])
        what = f"the video shows one picture in frames {where}: it was held, or the camera stalled"
        remedy = "copy the recording again, or capture the parts beside it alone (--frames A:B)"
        yield Finding(Severity.WARNING, name, what, remedy, held)
    others, count = len(halted) - len(held), sum(map(len, short))
    if count < max(_FEWEST, _SHARE * others):
        return
    where = ranges([start + frame for stretch in short for frame in stretch])
    what = (
        f"{count} of {others} frames show the picture of the frame before once more (frames "
        f"{where}), so that the person halts and leaps"
    )
    remedy = "give the video as it was filmed"
    if len(short) > _PAUSES:
        pictures = f"{rate * (1 - count / others):.4g}"
        what += f": there are {pictures} pictures a second, not {rate:.4g}"
        if single and np.ptp(np.diff([stretch[0] for stretch in short])) <= _REGULAR:
            filters = f"mpdecimate,setpts=N/{pictures}/TB"
            remedy += f", or drop these frames (ffmpeg -i IN -vf {filters} -r {pictures} OUT)"
    yield Finding(Severity.WARNING, name, what, remedy)


def _stretches(flags: NDArray[np.bool_]) -> Iterator[tuple[int, ...]]:
    """Runs of frames that are flagged."""
    for flagged, part in groupby(range(len(flags)), key=lambda frame: bool(flags[frame])):
        if flagged:
            yield tuple(part)
