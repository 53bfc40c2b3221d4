"""Photographs with annotated joints: a second source for fine-tuning, mixed with the first."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.detect.joint_set import LANDMARKS, canonical_name, doubled_names
from perfcap.errors import InputError
from perfcap.io.image_file import decode_image
from perfcap.train.backgrounds import digest_of
from perfcap.train.body_parts import UNKNOWN, part_map_size
from perfcap.train.crop_batches import Shots
from perfcap.train.photograph_checks import require_people
from perfcap.train.photograph_files import FEWEST, MOST_PIXELS, require_photographs
from perfcap.train.scenes import Shot

_LOG = logging.getLogger(__name__)

ANNOTATIONS, IMAGES = "annotations.json", "images"
_NOWHERE = ((0, 0), (-1, -1))  # where programs put what they do not know
_HANDFUL = 5  # joints whose visible is a fraction; more are of a network
_LIMIT = 256 * 2**20  # bytes of annotations


@dataclass(frozen=True, eq=False)
class Annotation:
    """One person in one photograph.

    Attributes:
        path: of the photograph.
        joints2d: landmarks, pixels with centres at integers, (16, 2); NaN where unknown.
    """

    path: Path
    joints2d: NDArray[np.float32]


class Photographs:
    """Shots of a folder of photographs.

    The folder holds ``images`` and ``annotations.json``: ``joint_names``, and ``images``, a list
    of ``file`` and ``joints``, rows of x, y, visible with the origin at the image's corner.
    Joints that are not visible are unknown. There are no 3D positions.

    Args:
        folder: of the photographs.
        size: of a shot, pixels.
        margin: of it, in boxes around the joints.

    Raises:
        InputError: it is missing or malformed, holds NaN, or shows nobody.
    """

    def __init__(self, folder: Path, size: int, margin: float) -> None:
        self.people = read_annotations(folder)
        self._size, self._margin = size, margin

    def __len__(self) -> int:
        return len(self.people)

    @property
    def digest(self) -> str:
        """SHA-256 of photographs and joints: another one is other data."""
        total = hashlib.sha256(digest_of(each.path for each in self.people).encode())
        for each in self.people:
            total.update(each.joints2d.tobytes())
        return total.hexdigest()

    def __getitem__(self, number: int) -> Shot:
        """A square around one person; joints that are not known are NaN.

        Raises:
            InputError: the photograph cannot be read, or has no joint inside.
        """
        annotation = self.people[number]
        image = read_photograph(annotation.path)
        joints = annotation.joints2d
        known = np.isfinite(joints).all(-1)
        height, width = image.shape[:2]
        inside = known & ((joints >= 0) & (joints < [width, height])).all(-1)
        if inside.sum() < FEWEST:
            raise InputError(
                f"{annotation.path}: has {int(inside.sum())} annotated joints in the image; "
                f"expected a person with at least {FEWEST}; remove it from {ANNOTATIONS}"
            )
        low, high = joints[inside].min(0), joints[inside].max(0)
        side = max(float((high - low).max()) * self._margin, 8.0)
        scale = side / self._size
        origin = 0.5 * (low + high) - scale * 0.5 * (self._size - 1)
        matrix = np.array([[scale, 0, origin[0]], [0, scale, origin[1]]])
        part = cv2.warpAffine(
            image,
            matrix,
            (self._size, self._size),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
        )
        unknown = np.full((len(LANDMARKS), 3), np.nan, np.float32)
        points = ((joints - origin) / scale).astype(np.float32)
        parts = np.full((part_map_size(self._size),) * 2, UNKNOWN, np.uint8)
        return Shot(np.asarray(part, np.uint8), points, unknown, float(self._size), True, parts)


def read_annotations(folder: Path) -> tuple[Annotation, ...]:
    """Annotated people of a folder.

    Raises:
        InputError: the file is missing, malformed, holds NaN, or names no person.
    """
    path = folder / ANNOTATIONS
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected photographs with annotated joints")
    if path.stat().st_size > _LIMIT:
        raise InputError(f"{path}: is larger than {_LIMIT >> 20} MB; split the photographs")
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        names = [canonical_name(str(name)) for name in table["joint_names"]]
        entries = list(_entries(table["images"]))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: is malformed ({type(error).__name__}: {error}); expected joint_names, and "
            "images with file and joints"
        ) from None
    columns = {name: names.index(name) for name in LANDMARKS if name in names}
    if not {"l_shoulder", "r_hip"} <= set(columns):
        raise InputError(
            f"{path}: joint_names lack shoulders or hips; expected names such as "
            f"{', '.join(LANDMARKS[:4])}"
        )
    own = [str(name) for name in table["joint_names"]]
    twice = doubled_names([name for name in own if canonical_name(name) in columns])
    if twice:
        raise InputError(
            f"{path}: joint_names has {twice:.200}, the same joint; expected each joint once: "
            "rename or remove what is not it"
        )
    if not entries:
        raise InputError(f"{path}: names no photograph; expected at least one")
    _say_unknown(path, own)
    found = tuple(_annotation(folder, path, entry, columns, len(names)) for entry in entries)
    _say_fractions(path, entries, list(columns.values()))
    joints = np.stack([each.joints2d for each in found])
    require_people(path, joints)
    require_photographs(path, [each.path for each in found], joints, entries)
    return found


def _say_unknown(path: Path, names: Sequence[str]) -> None:
    """Warn of joints that no landmark is called like: they are left out."""
    spare = [name for name in names if canonical_name(name) not in LANDMARKS]
    known = {canonical_name(name) for name in names}
    lacking = [name for name in LANDMARKS if name not in known]
    if spare:
        unseen = f", and {', '.join(lacking)} have no joints" if lacking else ""
        _LOG.warning(
            "%s: joint_names %s are none of the landmarks and are left out%s; expected names such "
            "as %s",
            *(path, ", ".join(spare), unseen, ", ".join(LANDMARKS[:4])),
        )


def _say_fractions(
    path: Path, entries: Sequence[Mapping[str, Any]], columns: Sequence[int]
) -> None:
    """Warn of values for visible that are fractions: confidences of a network, no marks."""
    visible = np.array([entry["joints"] for entry in entries], np.float32)[:, columns, 2]
    count = int(((visible > 0) & (visible != np.round(visible))).sum())
    if count > _HANDFUL:
        _LOG.warning(
            "%s: visible is a fraction for %d of %d joints, as confidences of a network are, and "
            "each above 0 counts as marked by hand; expected 0 or 1; set those that are not sure "
            "to 0",
            *(path, count, visible.size),
        )


def _entries(images: Any) -> Sequence[Mapping[str, Any]]:
    if isinstance(images, Mapping):
        return [{"file": name, **entry} for name, entry in images.items()]
    return list(images)


def _annotation(
    folder: Path,
    path: Path,
    entry: Mapping[str, Any],
    columns: Mapping[str, int],
    count: int,
) -> Annotation:
    name = str(entry.get("file") or entry.get("image") or entry.get("name") or "")
    if not name or Path(name).is_absolute() or ".." in Path(name).parts:
        raise InputError(f"{path}: file is {name!r:.60}; expected a name inside {IMAGES}")
    try:
        rows = np.asarray(entry["joints"], np.float32)
    except (KeyError, ValueError, TypeError):
        rows = np.zeros(0, np.float32)
    if rows.shape != (count, 3):
        raise InputError(
            f"{path}: joints of {name} have shape {rows.shape}; expected {(count, 3)}: x, y, "
            "visible"
        )
    if not np.isfinite(rows).all():
        raise InputError(f"{path}: joints of {name} are not finite; mark them as not visible")
    joints = np.full((len(LANDMARKS), 2), np.nan, np.float32)
    for landmark, column in columns.items():
        if rows[column, 2] > 0:
            if tuple(rows[column, :2]) in _NOWHERE:
                raise InputError(
                    f"{path}: {landmark} of {name} is visible at {rows[column, 0]:g}, "
                    f"{rows[column, 1]:g}; expected a pixel, or 0 for visible where it is unknown"
                )
            joints[LANDMARKS.index(landmark)] = rows[column, :2] - 0.5
    file = folder / name if (folder / name).is_file() else folder / IMAGES / name
    return Annotation(file, joints)


def read_photograph(path: Path) -> NDArray[np.uint8]:
    """A photograph as it is shown, RGB, (H, W, 3).

    Raises:
        InputError: it is not there, cannot be read, or is too large.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; the annotations name it")
    image = None
    with suppress(InputError):
        image = decode_image(path, cv2.IMREAD_COLOR_RGB, "a photograph")
    if image is None or image.shape[0] * image.shape[1] > MOST_PIXELS:
        raise InputError(f"{path}: cannot be read as a photograph; remove it from {ANNOTATIONS}")
    return image


# --- Two sources of shots as one ------------------------------------------------------------------


class Mixture:
    """Shots of two sources in turn; the smaller one comes round again as often as need be.

    Args:
        first: a source.
        second: another one.
    """

    def __init__(self, first: Shots, second: Shots) -> None:
        self._sources = (first, second)

    def __len__(self) -> int:
        return 2 * max(len(source) for source in self._sources)

    def __getitem__(self, number: int) -> Shot:
        """An even number is of the first source, an odd one of the second."""
        row, which = divmod(number, 2)
        source = self._sources[which]
        return source[row % len(source)]
