"""Arrays of keypoints without names: what scripts around MediaPipe, MoveNet, ViTPose save."""

from __future__ import annotations

import struct
import tokenize
from pathlib import Path

import numpy as np

from perfcap.errors import InputError
from perfcap.io.detections.listing import Listing, are_shares
from perfcap.io.detections.openpose import MAX_PEOPLE, choose_joint_set
from perfcap.io.detections.track import MAX_FRAMES, Array
from perfcap.io.files import MEBIBYTE, require_file

_LIMIT = 1024 * MEBIBYTE
_EXPECTED = "[F,J,3] or [F,P,J,3] of x, y, confidence, or FreeMoCap's [C,F,J,2]"
_CAMERAS = "numcams"  # in the name: FreeMoCap's arrays of all views
_ROWS_FIRST = "movenet"  # in the name: rows before columns
# of files that are cut or made up; the later ones come from numpy's parser of headers
_UNREADABLE = (OSError, ValueError, EOFError, OverflowError, MemoryError, SyntaxError, TypeError,
               LookupError, struct.error, tokenize.TokenError)  # fmt: skip
_BODY = 33  # MediaPipe's landmarks of the body, before those of hands and face
_DEEP = 4  # numbers of each: x, y, z, visibility
_UNSEEN = -1.0  # what some write for a joint without confidence
_BELOW_ZERO = 0.05, 0.1  # least of a confidence, networks round; share of joints that may be below
_PERCENT = 100.0  # some write these
_WITH_BODY = (75, 543, 553)


def read_keypoint_npy(path: Path) -> list[Listing]:
    """Keypoints of a view, or of all views in FreeMoCap's order of axes; one listing a view.

    Axes of length one that networks leave in place are dropped. The number of joints tells the
    joint set. In files named after MoveNet rows come before columns, as its network has them.

    Args:
        path: ``[F,J,3]`` or ``[F,P,J,3]``, pixels or shares of the image, with confidence; without,
            finite numbers are taken for seen. MediaPipe's ``[F,33,4]`` have a depth between, which
            is left out. ``[C,F,J,2]`` where the name says ``numCams``.

    Raises:
        InputError: it is damaged, holds objects, has another shape, or depths for confidences.
    """
    values = _load(path)
    name = path.name.lower()
    if _CAMERAS in name:
        if values.ndim != 4 or values.shape[-1] < 2:
            raise InputError(f"{path}: has shape {values.shape}, expected FreeMoCap's [C,F,J,2]")
        values = values[..., :2]
        body = values[..., :_BODY, :] if values.shape[2] in _WITH_BODY else values
        return [_listing(f"{path}: view {c + 1}", view[:, None]) for c, view in enumerate(body)]
    if values.ndim == 5 and values.shape[1] == 1:
        values = values[:, 0]
    shape = values.shape
    if values.ndim == 3:
        values = values[:, None]
    if values.ndim == 4 and values.shape[2:] == (_BODY, _DEEP):
        values = values[..., [0, 1, 3]]
    if values.ndim != 4 or values.shape[-1] not in (2, 3) or values.shape[1] > MAX_PEOPLE:
        raise InputError(f"{path}: has shape {shape}, expected {_EXPECTED}")
    if _ROWS_FIRST in name:
        values = values[..., [1, 0, 2][: values.shape[-1]]]
    if values.shape[2] in _WITH_BODY:
        values = values[:, :, :_BODY]
    if values.shape[-1] == 3:
        _require_confidence(path, values[..., 2])
    return [_listing(str(path), values)]


def _require_confidence(path: Path, third: Array) -> None:
    known = third[np.isfinite(third)]
    least, share = _BELOW_ZERO
    if known.size and float(np.median(known)) > _PERCENT:
        raise InputError(
            f"{path}: the third number of each joint is {known.min():.3g} to {known.max():.3g}, "
            "expected a confidence, 0 to 1; joints in space, as FreeMoCap's 3D, are not read: give "
            "those in the images"
        )
    if known.size and float(((known < -least) & (known != _UNSEEN)).mean()) > share:
        raise InputError(
            f"{path}: the third number of each joint is {known.min():.3g} to {known.max():.3g}, "
            "expected a confidence, 0 to 1; where it is a depth, as MediaPipe's z, give x, y and "
            "visibility"
        )


def _listing(where: str, values: Array) -> Listing:
    """Of people (F, P, J, 2 or 3); rows that are nowhere finite, or nowhere sure, are nobody."""
    if values.shape[-1] == 2:
        seen = np.isfinite(values).all(-1, keepdims=True) & (values != 0).any(-1, keepdims=True)
        values = np.concatenate((np.nan_to_num(values), seen.astype(np.float64)), -1)
    there = (np.nan_to_num(values[..., 2]) != 0).any(-1)
    frames = [list(row[kept]) for row, kept in zip(values, there, strict=True)]
    return Listing(where, choose_joint_set(where, frames), frames, shares=are_shares(frames))


def _load(path: Path) -> Array:
    require_file(path, _LIMIT, f"an array of keypoints, {_EXPECTED}")
    try:
        found = np.load(path, mmap_mode="r", allow_pickle=False)
    except _UNREADABLE as error:
        if "Python objects" in str(error) or "allow_pickle" in str(error):
            raise InputError(
                f"{path}: is no array of numbers (Python objects, as lists of different lengths); "
                f"fill up what is missing with NaN and write {_EXPECTED}"
            ) from None
        said = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise InputError(f"{path}: is no array of numbers ({said}); write it again") from None
    if not isinstance(found, np.ndarray) or found.dtype.kind not in "fiu":
        kind = found.dtype if isinstance(found, np.ndarray) else type(found).__name__
        raise InputError(f"{path}: holds {kind}, expected numbers: {_EXPECTED}")
    if found.ndim < 3 or 0 in found.shape or max(found.shape[:2]) > MAX_FRAMES:
        raise InputError(f"{path}: has shape {found.shape}, expected {_EXPECTED}")
    return np.array(found, dtype=np.float64)
