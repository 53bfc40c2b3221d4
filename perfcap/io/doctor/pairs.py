"""Whether joints of both sides are exchanged: bones that cross change their length."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.finding import Finding, Severity

# Bones that end at a joint. Exchanged hips or shoulders turn a whole part of the body round, see
# ``examine_sides``.
BONES = {
    "elbow": ("shoulder", "wrist"),
    "wrist": ("elbow",),
    "knee": ("hip", "ankle"),
    "ankle": ("knee", "toe"),
    "toe": ("ankle",),
}
# One joint, or those that follow it in the limb as well: then a single bone crosses
_PARTS = (
    *((name,) for name in BONES),
    ("elbow", "wrist"),
    ("knee", "ankle", "toe"),
    ("knee", "ankle"),
    ("ankle", "toe"),
)
# of what is as named: spread of lengths, lengths of single joints, and of limbs, of which a single
# bone says it. Bones that are far shorter, and of one length, need not be steadier, which errors of
# joints hide
_STEADIER, _SHORTER, _LIMB_SHORTER = 0.8, 0.9, 0.95
_FAR_SHORTER, _ALIKE = 0.75, 1.15
# In clips of fewer frames errors of joints often stay what they are, and make right bones longer
# than crosswise (``pairs_of_clips.py``). Several views of longer ones are looked at in as many
# frames, evenly spread
_FEW, _SHORTER_OF_FEW, _LIMB_SHORTER_OF_FEW = 24, 0.8, 0.92
_FEWEST = 10  # frames
_REMEDY = "exchange their names or columns: in the order of the joints they are each other's"


def examine_pairs(subject: str, points: Tensor) -> list[Finding]:
    """Wrists, elbows, toes, ankles or knees that are each other's, as in an order made by hand.

    Each alone, or with those that follow in the limb.

    The bones that end at them are then shorter the other way round, and their lengths steadier.
    In clips of less than 24 frames they must be clearly shorter: errors of joints that stay for a
    while look a little like it in right ones.

    Args:
        subject: of the finding.
        points: landmarks (F, 16, 3) in the world or in the axes of a camera, metres, NaN where
            unknown.
    """
    found: set[str] = set()
    while wrong := [part for part in _PARTS if found.isdisjoint(part) and _exchanged(part, points)]:
        # elbows that are exchanged make wrists look so; without the right ones all bones are steady
        undone = {part: exchange(part, points) for part in wrong}
        best = min(undone, key=lambda part: _looseness(undone[part]))
        found.update(best)
        points = undone[best]
    if not found:
        return []
    pairs = ", ".join(f"l_{name} and r_{name}" for name in BONES if name in found)
    what = f"{pairs} look exchanged: the bones that end there are shorter and steadier crosswise"
    return [Finding(Severity.ERROR, subject, what, _REMEDY)]


def exchange(names: Iterable[str], points: Tensor) -> Tensor:
    """Points (F, 16, 3) with joints of both sides in each other's place."""
    order = list(range(len(LANDMARKS)))
    for name in names:
        left, right = (LANDMARKS.index(f"{side}_{name}") for side in "lr")
        order[left], order[right] = right, left
    return points[:, order]


def _exchanged(part: tuple[str, ...], points: Tensor) -> bool:
    """Whether the bones of joints, of both sides together, are those of the other side's joints."""
    name, *more = part
    before = BONES[name][:1] if more else BONES[name]
    named, crossed = (
        torch.tensor([*_bones(name, points, other, before)]) for other in ((*"lr",), (*"rl",))
    )
    if not len(named) or not bool((named.isfinite() & crossed.isfinite()).all()):
        return False
    (long, loose), (short, steady) = named.sum(0).tolist(), crossed.sum(0).tolist()
    if more and short < _FAR_SHORTER * long:
        one, other = crossed[:, 0].sort().values.tolist()
        if other < _ALIKE * one:
            return True
    if len(points) < _FEW:
        shorter = _LIMB_SHORTER_OF_FEW if more else _SHORTER_OF_FEW
    else:
        shorter = _LIMB_SHORTER if more else _SHORTER
    return bool(short < shorter * long and steady < _STEADIER * loose)


def _looseness(points: Tensor) -> float:
    """Spread of all bones as they are named, m."""
    spreads = [
        spread for name in BONES for _, spread in _bones(name, points, ("l", "r"), BONES[name])
    ]
    return float(torch.tensor(spreads).nansum())


def _bones(
    name: str, points: Tensor, sides: tuple[str, ...], others: Sequence[str]
) -> Iterator[tuple[float, float]]:
    """Median and half the range of the middle half of the lengths of a joint's bones, m.

    Args:
        name: of the joint.
        points: (F, 16, 3).
        sides: of the joint whose bones begin at left and right others.
        others: where its bones begin.
    """
    for lengths in bone_lengths(name, points, sides, others).unbind(-1):
        known = lengths[lengths.isfinite()]
        if len(known) < _FEWEST:
            yield torch.nan, torch.nan
            continue
        low, middle, high = known.quantile(known.new_tensor([0.25, 0.5, 0.75])).tolist()
        yield middle, 0.5 * (high - low)


def bone_lengths(
    name: str, points: Tensor, sides: Sequence[str], others: Sequence[str] | None = None
) -> Tensor:
    """Lengths of bones that end at a joint of both sides, (F, N), metres.

    Args:
        name: of the joint.
        points: (F, 16, 3).
        sides: of the joint whose bones begin at left and right others.
        others: where its bones begin; all of ``BONES`` when not given.
    """
    at = dict(zip(LANDMARKS, points.unbind(-2), strict=True))
    lengths = [
        (at[f"{begin}_{other}"] - at[f"{end}_{name}"]).norm(dim=-1)
        for other in (BONES[name] if others is None else others)
        for begin, end in zip("lr", sides, strict=True)
    ]
    return torch.stack(lengths, -1)
