"""Whether annotated joints are of people, under the names that they have, in these photographs.

What is wrong may be so in a part of the list only, as after a line that was lost. Tests of names
and places are therefore made of stretches of it too. Poses are not: a list may be sorted by them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.doctor.doubled import examine_doubled

Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]

PEOPLE = 20  # fewer say nothing
_NORMALISED = 2.0  # pixels: nobody is so small
_MANY_NORMALISED = 0.01  # of the people: one may be a slip
_UPRIGHT = 0.35  # share: of athletes and gymnasts it is 0.68
_ASIDE = 1 - _UPRIGHT
# Of lspet, whole and in stretches of 120: joints along limbs are in order in 0.79 to 1.00 of the
# people and nearer to their own side's in 0.70 to 0.98, hips and shoulders agree about sides in
# 0.91 to 1.00, and 0.44 to 0.73 of those upside down face the camera. Under wrong names it is 0.03
# to 0.14, 0.06 to 0.14, 0.04 and, where y was counted from the bottom, 0.25.
_WRONG, _DISAGREEING, _MIRRORED = 0.25, 0.3, 0.32
_INVERTED, _STEEP = 0.5, 0.5  # share of the people, and cosine of their trunks to down or aside
_TOLD = 30  # people of whom a share is told
_CLEAR = 0.1  # of both distances, by which one is the smaller
_BROAD = 0.15  # of the square of the trunk, for lines through hips and shoulders that say a side
_LENGTHS = (0.7, 1.5)  # of the second bone in those of the first, medians of people 0.85 to 1.07
_STRETCHES, _SHORTEST, _LONGEST = 10, 60, 500  # of a list, and people in each
_CHAINS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
_QUARTER = 0.55  # of the sides: labels of copies half as large end there
_WHOLE = 0.8  # of the sides, that joints of other stretches reach
_SMALLER = 0.6  # times the size of people elsewhere who reach further
_OUTSIDE, _OUTSIDE_STRETCH = 0.05, 0.1  # of the joints: who is cut off has some


def require_people(path: Path, joints: Floats) -> None:
    """Refuse joints (N, 16, 2) that are no pixels, not of people, or not under their names.

    Raises:
        InputError: naming the part of the list and what is odd there.
    """
    _require_pixels(path, joints)
    _require_upright(path, joints)
    for part in stretches(len(joints)):
        here = joints[part]
        for what in (*_names(here), *_mirrored(here), *_doubled(here)):
            raise InputError(f"{path}: {where(part, len(joints))}{what}")


def _doubled(joints: Floats) -> Iterator[str]:
    """Joints that are copies of others, as of a list that was filled up."""
    places = torch.from_numpy(joints)
    for finding in examine_doubled("", places, places.isfinite().all(-1), true=True):
        yield f"{finding.what}; leave joints out that were not annotated"


def stretches(count: int) -> Iterator[slice]:
    """The whole list, and overlapping parts of it."""
    yield slice(0, count)
    size = int(np.clip(count // _STRETCHES, _SHORTEST, _LONGEST))
    for start in range(0, count - size + 1, max(1, size // 2)):
        if size < count:
            yield slice(start, start + size)


def where(part: slice, count: int) -> str:
    """Words before what is odd of a stretch of a list; none of the whole list."""
    whole = part.stop - part.start == count
    return "" if whole else f"in people {part.start} to {part.stop - 1} of the list, "


def _at(joints: Floats, name: str) -> Floats:
    found: Floats = joints[:, LANDMARKS.index(name)]
    return found


def _apart(joints: Floats, one: str, other: str) -> Floats:
    found: Floats = np.linalg.norm(_at(joints, one) - _at(joints, other), axis=-1)
    return found


def _middle(joints: Floats, name: str) -> Floats:
    found: Floats = 0.5 * (_at(joints, f"l_{name}") + _at(joints, f"r_{name}"))
    return found


def _require_pixels(path: Path, joints: Floats) -> None:
    known = np.isfinite(joints).all(-1).any(-1)
    size = np.abs(np.nan_to_num(joints)).max((1, 2))
    tiny = known & (size <= _NORMALISED)
    if tiny.sum() > _MANY_NORMALISED * known.sum():
        most = float(size[tiny].max())
        raise InputError(
            f"{path}: joints of {int(tiny.sum())} people are up to {most:.2g}, expected pixels; "
            "multiply by the image size"
        )


def _require_upright(path: Path, joints: Floats) -> None:
    """Most people of a list stand, if not most of a part of it."""
    neck, shoulders = _at(joints, "neck"), _middle(joints, "shoulder")
    above = np.where(np.isfinite(neck), neck, shoulders)
    down = _middle(joints, "ankle") - above
    if np.isfinite(down).all(-1).sum() < PEOPLE:
        down = _middle(joints, "hip") - above
    down = down[np.isfinite(down).all(-1)]
    if len(down) < PEOPLE:
        return
    upright = float((down[:, 1] > 0).mean())
    aside = float((down[:, 0] > np.abs(down[:, 1])).mean())
    if upright < _UPRIGHT or aside > _ASIDE:
        raise InputError(
            f"{path}: {upright:.0%} of the people have their feet below their necks; expected x "
            "before y, y down, and joints in the order of joint_names"
        )


def _smaller(one: Floats, other: Floats) -> float:
    """Share of those clearly of different size of whom the first is smaller; NaN of too few."""
    clear = np.abs(one - other) > _CLEAR * (one + other)  # false where one is unknown
    return float((one < other)[clear].mean()) if clear.sum() >= _TOLD else np.nan


def _names(joints: Floats) -> Iterator[str]:
    """Names that belong to other joints."""
    for side, other in ("lr", "rl"):
        for chain in _CHAINS:
            first, middle, last = (f"{side}_{name}" for name in chain)
            yield from _order(joints, first, middle, last)
            for upper, lower in (chain[:2], chain[1:]):
                own = _apart(joints, f"{side}_{upper}", f"{side}_{lower}")
                across = _apart(joints, f"{other}_{upper}", f"{side}_{lower}")
                share = _smaller(own, across)
                if share < _WRONG:
                    yield (
                        f"{side}_{lower} is nearer to {side}_{upper} than to {other}_{upper} in "
                        f"{share:.0%} of the people; expected joints in the order of joint_names, "
                        "and the person's own left and right"
                    )
    yield from _crown(joints)
    yield from _sides(joints)


def _crown(joints: Floats) -> Iterator[str]:
    """A neck that is farther from the shoulders than the crown: of 96 % of lspet it is nearer."""
    middle = _middle(joints, "shoulder")
    neck, crown = (
        np.linalg.norm(_at(joints, name) - middle, axis=-1) for name in ("neck", "head_top")
    )
    share = _smaller(neck, crown)
    if share < _WRONG:
        yield (
            f"neck is nearer to the shoulders than head_top in {share:.0%} of the people; expected "
            "joints in the order of joint_names (are neck and head_top exchanged?)"
        )


def _order(joints: Floats, first: str, middle: str, last: str) -> Iterator[str]:
    """A middle joint that is an end of its limb: by lengths, and by which is the longer way."""
    upper, lower = _apart(joints, first, middle), _apart(joints, middle, last)
    whole = _apart(joints, first, last)
    known = np.isfinite(upper + lower) & (upper > 0)
    if known.sum() < _TOLD:
        return
    ratio = float(np.median(lower[known] / upper[known]))
    if _LENGTHS[0] <= ratio <= _LENGTHS[1]:
        return
    for share, one in ((_smaller(upper, whole), last), (_smaller(lower, whole), first)):
        if share < _WRONG:
            yield (
                f"{middle} lies beyond {one} on the way from {first} to {last} in "
                f"{1 - share:.0%} of the people; expected joints in the order of joint_names "
                f"(are {middle} and {one} exchanged?)"
            )


def _sides(joints: Floats) -> Iterator[str]:
    """Arms whose left is the legs' right."""
    shoulders, hips = (
        _at(joints, f"l_{name}") - _at(joints, f"r_{name}") for name in ("shoulder", "hip")
    )
    trunk = ((_middle(joints, "shoulder") - _middle(joints, "hip")) ** 2).sum(-1)
    along = (shoulders * hips).sum(-1)
    size = np.linalg.norm(shoulders, axis=-1) * np.linalg.norm(hips, axis=-1)
    broad = size > _BROAD * trunk  # false where one is unknown
    if broad.sum() >= _TOLD:
        share = float((along > 0)[broad].mean())
        if share < _DISAGREEING:
            yield (
                f"left and right of shoulders and of hips agree in {share:.0%} of the people; "
                "expected the person's own left and right in both"
            )


def _mirrored(joints: Floats) -> Iterator[str]:
    """Many people upside down or lying who turn their backs: their pictures are mirror images.

    Who stands on their hands is turned, not mirrored, and faces the camera as often as others.
    """
    up = _middle(joints, "shoulder") - _middle(joints, "hip")
    left = _at(joints, "l_shoulder") - _at(joints, "r_shoulder")
    turn = up[:, 0] * left[:, 1] - up[:, 1] * left[:, 0]
    told = np.abs(turn) > 0.2 * (up**2).sum(-1)  # false where one is unknown
    steep = _STEEP * np.linalg.norm(up, axis=-1)
    ways = {
        "are upside down": (up[:, 1] > steep, "y down from the photograph's top"),
        "lie with their heads to the left": (-up[:, 0] > steep, "x before y"),
    }
    for what, (so, expected) in ways.items():
        many = told & so
        if many.sum() < _TOLD or many.sum() < _INVERTED * told.sum():
            continue
        share = float((turn > 0)[many].mean())
        if share < _MIRRORED:
            yield (
                f"{many.sum() / told.sum():.0%} of the people {what}, and {share:.0%} of these "
                f"face the camera, as in a mirror; expected {expected}"
            )


def require_places(path: Path, joints: Floats, sizes: Floats, outside: Flags) -> None:
    """Refuse joints that lie elsewhere than in their photographs, or of smaller copies of them.

    Args:
        path: of the annotations.
        joints: (N, 16, 2), pixels, NaN where unknown.
        sizes: width and height of each photograph, (N, 2).
        outside: joints that lie outside of their photographs, (N, 16).

    Raises:
        InputError: naming the part of the list and what is odd there.
    """
    known = np.asarray(np.isfinite(joints).all(-1))
    filled = np.where(known[..., None], joints, -np.inf)
    reach = (filled.max(1) / sizes).max(-1)  # -inf of nobody
    span = np.where(known[..., None], joints, np.inf).min(1)
    size = ((filled.max(1) - span) / sizes).max(-1)
    whole = len(joints)
    for part in stretches(whole):
        share = outside[part].sum() / max(1, known[part].sum())
        allowed = _OUTSIDE if part.stop - part.start == whole else _OUTSIDE_STRETCH
        if share > allowed:
            raise InputError(
                f"{path}: {where(part, whole)}{share:.0%} of the joints lie outside of their "
                "photographs; expected pixels of these very files, and joints of the person in each"
            )
        if float(reach[part].max()) >= _QUARTER:
            continue
        if part.stop - part.start == whole:
            raise InputError(
                f"{path}: joints of all {whole} people lie in the upper left quarter of their "
                "photographs; expected pixels of these very files, not of smaller copies"
            )
        rest: Flags = reach >= _QUARTER  # nobody of this part
        small = np.median(size[part]) < _SMALLER * np.median(size[rest])
        if small and float(reach.max()) > _WHOLE:
            raise InputError(
                f"{path}: {where(part, whole)}joints lie in the upper left quarter of the "
                "photographs, and people are smaller than elsewhere; expected pixels of these very "
                "files, not of smaller copies"
            )
