"""Whether a network sees the people of photographs where their joints are marked.

Marks alone do not show that they are of other photographs, a little aside, or that left and right
are each other's in all of them; pictures do. A network errs, and marks differ from what it has
learned, so that many people are judged together: stretches of the list, as for ``require_people``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.detect.known_person import JUDGED, NEAR, OPPOSITE, Floats, look_at_known
from perfcap.detect.look import CropNetwork
from perfcap.errors import InputError
from perfcap.train.photograph_checks import PEOPLE, stretches, where
from perfcap.train.photographs import Annotation, read_photograph

Shares = NDArray[np.float64]

_MOST = 400  # people who are looked at
# Of lspet, `lightning` sees 0.64 of the joints where they are marked and 0.22 on the other side; in
# stretches of 20 people 0.46 and more, and never less than 0.2 more than on the other side. Where
# joints are of the next photograph it is 0.02, of mirror images 0.12, 20 pixels aside 0.07, and
# of copies 0.9 or 1.1 times as large 0.13 and 0.23.
_FEW = 0.35
_OTHER_SIDE = 0.15  # more of them
_MIRRORED = 0.45  # found in mirror images of those of whom few are found


def photograph_doubts(
    path: Path, network: CropNetwork, people: Sequence[Annotation]
) -> Iterator[str]:
    """What speaks against joints of photographs, by what a network sees in some of them.

    Args:
        path: of the annotations, for messages.
        network: of joints, that looks at crops.
        people: annotated ones, in the order of the list.

    Raises:
        InputError: left and right are each other's, or photographs or joints are mirrored.
    """
    numbers = range(0, len(people), max(1, -(-len(people) // _MOST)))
    if len(numbers) < PEOPLE:
        return
    found = np.stack([_found(network, people[number]) for number in numbers])
    for part in stretches(len(people)):
        rows = [row for row, number in enumerate(numbers) if part.start <= number < part.stop]
        if len(rows) < PEOPLE:
            continue
        here = where(part, len(people))
        own, other = (float(share) for share in found[rows].mean(0))
        if other > own + _OTHER_SIDE:
            raise InputError(
                f"{path}: {here}a network sees {other:.0%} of the joints where those of the other "
                f"side are marked, and {own:.0%} where they are; expected the person's own left "
                "and right"
            )
        if own >= _FEW:
            continue
        images = [_found(network, people[numbers[row]], mirrored=True) for row in rows]
        if max(np.mean(images, 0)) > _MIRRORED:
            raise InputError(
                f"{path}: {here}a network sees {own:.0%} of the joints where they are marked, in "
                f"mirror images of the photographs {max(np.mean(images, 0)):.0%}; expected joints "
                "of the photographs as they are: mirror both, or none"
            )
        yield (
            f"{path}: {here}a network sees {own:.0%} of the joints where they are marked (of sound "
            "ones 60 %); check that they are pixels of these very photographs, and of the "
            "people in them, unless people are hard to see there"
        )
        return


def _found(network: CropNetwork, person: Annotation, mirrored: bool = False) -> Shares:
    """Shares of the joints that are seen where they are marked, and where the other side's are.

    Args:
        network: looks at a crop around the joints.
        person: whom to look at.
        mirrored: look at the mirror image of the photograph, at the same place.
    """
    image, joints = read_photograph(person.path), person.joints2d.astype(np.float64)
    seen = look_at_known(
        network, np.ascontiguousarray(image[:, ::-1]) if mirrored else image, joints
    )
    if seen is None:
        return np.zeros(2)
    limit = NEAR * float((np.nanmax(joints, 0) - np.nanmin(joints, 0)).max())
    return np.array([_share(seen[0], marked, limit) for marked in (joints, joints[OPPOSITE])])


def _share(seen: Floats, marked: Floats, limit: float) -> float:
    """How many of the marked joints (16, 2) are seen within a limit, pixels."""
    apart = np.linalg.norm(seen - marked, axis=-1)[JUDGED]
    apart = apart[np.isfinite(apart)]
    return float((apart <= limit).mean()) if len(apart) else 0.0
