"""Whether pictures to show people before are what they should be: of places, without people.

People in them would be learned as what is no person, and masks or black pictures as what all places
look like. Both end in a network that finds fewer people in videos, and no score in rendered crops
shows it: these have the same pictures behind them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from perfcap.detect.look import Finder, sureness
from perfcap.train.backgrounds import Picture, read_picture

_MOST = 60  # pictures that are looked at
# Of `multipose` in 100 photographs of athletes: 60 %; in 116 pictures of rooms, things and painted
# clutter: none.
_SURE = 0.5
_MANY = 0.1  # of the pictures
_FEWEST = 2
_FLAT = 0.98  # of the pixels of a mask, or of a picture of one colour, are in two levels


def background_doubts(folder: Path, files: Sequence[Path], finder: Finder) -> Iterator[str]:
    """What speaks against pictures as backgrounds, by some of them.

    Args:
        folder: of the pictures, for messages.
        files: the pictures.
        finder: finds people in whole images.

    Raises:
        InputError: a picture cannot be read.
    """
    chosen = files[:: max(1, -(-len(files) // _MOST))]
    people, flat = [], []
    for file in chosen:
        picture = read_picture(file)
        if _is_flat(picture):
            flat.append(file)
        elif any(sureness(look.confidence, finder.joint_set) >= _SURE for look in finder(picture)):
            people.append(file)
    for found, what, expected in (
        (people, "show people", "pictures without people, who are learned as background otherwise"),
        (flat, "have one or two colours, as masks have", "photographs of places"),
    ):
        if len(found) >= max(_FEWEST, _MANY * len(chosen)):
            yield (
                f"--backgrounds {folder}: {len(found)} of {len(chosen)} pictures that were looked "
                f"at {what} ({found[0].name}, {found[1].name}); expected {expected}"
            )


def _is_flat(picture: Picture) -> bool:
    """Whether nearly all pixels have one of two levels of grey."""
    count = np.sort(np.bincount((picture.mean(-1) / 8).astype(int).ravel(), minlength=32))
    return bool(count[-2:].sum() >= _FLAT * count.sum())
