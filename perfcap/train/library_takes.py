"""Whether takes of a person are of a size of people, and in the units, axes and sides of the rest.

Checks of a whole person look at all frames together, in which a few wrong takes are lost.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import median

from torch import Tensor

from perfcap.train.library_checks import bone_lengths, side_fault, usually_upright

_LEG = (0.5, 1.2)  # m, hip to ankle; of the CMU library 0.75 to 0.92
_LONGER = 1.15  # times a bone of a person's other takes: skeletons are fitted take by take
# m of the lowest joint above or below the floor of the takes of who stands: who lies, or stands on
# their hands, touches it
_AFLOAT = 0.15
_NAMED = 4  # clips in a sentence


def size_doubts(clips: Sequence[Tensor]) -> Iterator[str]:
    """What speaks against the size of a person of clips with landmarks (F, 16, 3)."""
    lengths = [bone_lengths(points) for points in clips]
    leg = median(own["left thigh"] + own["left shank"] for own in lengths)
    if not _LEG[0] < leg < _LEG[1]:
        yield (
            f"legs are {leg:.2g} m long, those of grown people 0.65 to 1.05; if this is none, "
            "offsets_m and root_m are not in metres (divide lengths of the CMU files by 0.45)"
        )


def take_doubts(
    names: Sequence[str], takes: Sequence[Tensor], angles: Sequence[str | None]
) -> Iterator[str]:
    """What speaks against single takes of one person.

    Args:
        names: of the takes.
        takes: their landmarks (F, 16, 3), metres, y up.
        angles: what speaks against the angles of each; None if nothing does.
    """
    yield from _sizes(names, takes)
    wrong: dict[str, list[str]] = {}
    for name, points, misread in zip(names, takes, angles, strict=True):
        fault = misread or side_fault([points])  # one explains the other
        if fault is not None:
            wrong.setdefault(fault, []).append(name)
    yield from (f"{_clips(some)}: {fault}" for fault, some in wrong.items())
    if not usually_upright(takes):  # the person is named, or lies
        return
    upright = [usually_upright([points]) for points in takes]
    lowest = [points[..., 1].amin(1) for points in takes]
    floor = median(
        float(low.median()) for low, stands in zip(lowest, upright, strict=True) if stands
    )
    beside = [
        name
        for name, low, stands in zip(names, lowest, upright, strict=True)
        if not stands and float((low - floor).abs().median()) > _AFLOAT
    ]
    if beside:
        yield (
            f"{_clips(beside)}: who lies there, or stands on their head, is not on the floor of "
            "the other clips; if they stand, root_m and euler_zyx_deg of the root are not y up, in "
            "degrees"
        )


def _sizes(names: Sequence[str], takes: Sequence[Tensor]) -> Iterator[str]:
    """Takes with bones that are longer or shorter than the person's usually are."""
    bones = [bone_lengths(points) for points in takes]
    usual = {bone: max(median(own[bone] for own in bones), 1e-6) for bone in bones[0]}
    other: dict[str, float] = {}
    for name, own in zip(names, bones, strict=True):
        factors = [own[bone] / usual[bone] for bone in usual]
        apart = max(factors, key=lambda factor: max(factor, 1 / max(factor, 1e-6)))
        if not 1 / _LONGER < apart < _LONGER:
            other[name] = apart
    if other:
        least, most = min(other.values()), max(other.values())
        times = f"{least:.2g}" if most < 1.05 * least else f"{least:.2g} to {most:.2g}"
        yield (
            f"{_clips(list(other))}: bones are {times} times as long as this person's usually are; "
            "give offsets_m and root_m of all clips in metres (divide lengths of the CMU files by "
            "0.45), or another person their own subject"
        )


def _clips(names: Sequence[str]) -> str:
    """The first of some clips, and how many there are more."""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"clip{'s' * (len(names) > 1)} {', '.join(names[:_NAMED])}{more}"
