"""Whether photographs can be learned from, and are those that their joints were marked in.

All are looked at before the first step: a training would come to some of them after hours, and
one that goes on must have the photographs that it began with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.exif import is_turned
from perfcap.io.image_file import image_size
from perfcap.train.photograph_checks import PEOPLE, Flags, Floats, require_places
from perfcap.train.photograph_copies import require_whole

FEWEST = 6  # joints that say where somebody is
MOST_PIXELS = 64 * 10**6
_HEADER = 2**18  # bytes that say how large a photograph is
_NAMED = 3  # photographs of a message
_OUTSIDE, _LEVEL = 0.05, 0.75  # shares of joints and of trunks, of turned photographs
_FEW = 5  # turned photographs, of which a share of joints is told


def require_photographs(
    path: Path, files: Sequence[Path], joints: Floats, entries: Sequence[Mapping[str, Any]]
) -> None:
    """Refuse photographs that are not there, cannot be used, or are not those of their joints.

    Args:
        path: of the annotations.
        files: a photograph a person.
        joints: (N, 16, 2), pixels, NaN where unknown.
        entries: of the annotations, with ``width`` and ``height`` where they say so.

    Raises:
        InputError: naming the first few, or what is odd of all.
    """
    sizes, turned = np.zeros((len(files), 2), np.float32), np.zeros(len(files), bool)
    bad: list[tuple[Path, str, str]] = []
    for row, (file, entry) in enumerate(zip(files, entries, strict=True)):
        found = _look(file)
        if isinstance(found, str):
            advice = (
                "the annotations name it" if not file.is_file() else f"remove it from {path.name}"
            )
            bad.append((file, found, advice))
            continue
        sizes[row], turned[row] = found
        told = (entry.get("width"), entry.get("height"))
        # either side may be first: cameras that were held upright write the longer one so
        if None not in told and {*told} != {*sizes[row].tolist()}:
            width, height = sizes[row].astype(int)
            raise InputError(
                f"{path}: says that {file.name} has {told[0]}x{told[1]} pixels, it has "
                f"{width}x{height}; annotate the photographs as they are"
            )
    _refuse(path, bad)
    known = np.asarray(np.isfinite(joints).all(-1))
    with np.errstate(invalid="ignore"):
        beyond = np.asarray(((joints < -1) | (joints > sizes[:, None])).any(-1))
        inside = known & ((joints >= 0) & (joints < sizes[:, None])).all(-1)
    outside = known & beyond
    _require_as_shown(path, joints[turned], known[turned], outside[turned])
    judged = known.any(-1)
    if judged.sum() >= PEOPLE:
        require_places(path, joints[judged], sizes[judged], outside[judged])
        require_whole(path, joints[judged], sizes[judged])
    advice = f"expected a person with at least {FEWEST}; remove it from {path.name}"
    counts = enumerate(inside.sum(1).tolist())
    _refuse(
        path,
        [
            (files[row], f"has {count} annotated joints in the image", advice)
            for row, count in counts
            if count < FEWEST
        ],
    )


def _look(file: Path) -> tuple[tuple[int, int], bool] | str:
    """Width and height as shown and whether that is turned, or why a photograph is none."""
    if not file.is_file():
        return "no such file"
    with file.open("rb") as opened:
        head = opened.read(_HEADER)
    size, turned = image_size(head), is_turned(head)
    if size is None:  # of another kind, or of none
        image = cv2.imread(str(file), cv2.IMREAD_COLOR) if head else None
        size, turned = (0, 0) if image is None else (image.shape[1], image.shape[0]), False
    if not 0 < size[0] * size[1] <= MOST_PIXELS:
        return "cannot be read as a photograph"
    return size[::-1] if turned else size, turned


def _refuse(path: Path, bad: Sequence[tuple[Path, str, str]]) -> None:
    """Name a photograph that cannot be used, or the first few, with what to do."""
    if not bad:
        return
    if len(bad) == 1:
        file, what, advice = bad[0]
        raise InputError(f"{file}: {what}; {advice}")
    some = ", ".join(f"{file.name} ({what})" for file, what, _ in bad[:_NAMED])
    more = ", ..." if len(bad) > _NAMED else ""
    raise InputError(
        f"{path}: {len(bad)} photographs cannot be used: {some}{more}; expected photographs of a "
        f"person with at least {FEWEST} joints in each; remove these from {path.name}"
    )


def _require_as_shown(path: Path, joints: Floats, known: Flags, outside: Flags) -> None:
    """Refuse joints of photographs as stored, (N, 16, 2), that are shown turned by a quarter."""
    count = len(joints)
    share = outside.sum() / max(1, known.sum())
    shoulders, hips = (
        joints[:, [LANDMARKS.index(f"{side}_{name}") for side in "lr"]].mean(1)
        for name in ("shoulder", "hip")
    )
    trunk = np.abs(shoulders - hips)
    trunk = trunk[np.isfinite(trunk).all(-1)]
    level = float((trunk[:, 0] > trunk[:, 1]).mean()) if len(trunk) >= PEOPLE else 0.0
    if (count >= _FEW and share > _OUTSIDE) or level > _LEVEL:
        raise InputError(
            f"{path}: {count} photographs are shown turned by a quarter, as their EXIF orientation "
            f"says; {share:.0%} of their joints lie outside then, and {level:.0%} of the people; "
            "expected pixels of photographs as they are shown: turn the joints, or take the "
            "orientation out of the files"
        )
