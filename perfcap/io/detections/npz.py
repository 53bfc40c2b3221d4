"""``detections.npz``: joints as arrays, read and written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.detections import Detections, unit_of
from perfcap.detect.joint_set import KNOWN_JOINTS, LANDMARKS, LANDMARKS16, JointSet, canonical_name
from perfcap.errors import InputError, one_line
from perfcap.io.archive import other_arrays, read_archive
from perfcap.io.atomic import writing
from perfcap.io.detections.listing import Listing
from perfcap.io.detections.track import MAX_FRAMES, Array, Track
from perfcap.io.view_names import match_views

MAX_PEOPLE = 1000
_ARRAYS = (
    *("joints2d", "confidence2d", "joints3d_mm", "joint_names", "view_names"),
    "video_frames",
)


def read_npz(path: Path, views: Sequence[str] | None = None) -> list[Track] | list[Listing]:
    """Read ``joints2d`` [F,J,2] or [F,C,J,2], ``confidence2d``, and optionally 3D and names.

    Several people are [F,C,P,J,2], in no order, where P is the most in a frame and view; rows of
    confidence 0 are nobody.

    Args:
        path: the archive. ``joints3d_mm`` [F,(C,)J,3] is root-relative, in camera axes;
            ``joint_names`` [J] defaults to the 16 landmarks; ``video_frames`` says how long the
            video is, of which the file may hold the first frames only.
        views: names of the cameras wanted, used when the file names its own (``view_names``).

    Returns:
        One track a view, or one listing where the file holds several people.
    """
    arrays = read_archive(path, _ARRAYS, "detections.npz")
    joints2d = _numbers(path, arrays, "joints2d")
    confidence = _numbers(path, arrays, "confidence2d")
    if joints2d.ndim not in (3, 4, 5) or joints2d.shape[-1] != 2 or 0 in joints2d.shape:
        raise InputError(
            f"{path}: joints2d has shape {joints2d.shape}, expected [F,J,2], [F,C,J,2], or "
            "[F,C,P,J,2] of several people"
        )
    _same_shape(path, "confidence2d", confidence, joints2d.shape[:-1])
    joint_set = _joint_set(path, arrays, joints2d.shape[-2])
    notes = _unread(path)
    if joints2d.ndim == 5:
        people = np.concatenate((joints2d, confidence[..., None]), -1)
        return _listings(path, arrays, people, joint_set, views, notes)
    joints3d = None
    if "joints3d_mm" in arrays:
        joints3d = _numbers(path, arrays, "joints3d_mm")
        _same_shape(path, "joints3d_mm", joints3d, (*joints2d.shape[:-1], 3))
        _check_millimetres(path, joints3d)
        joints3d = joints3d / 1000
    track = Track(
        str(path), joint_set, joints2d, confidence, joints3d, notes, _video_frames(path, arrays)
    )
    if joints2d.ndim == 3:
        return [track]
    return [
        replace(
            track,
            where=f"{path}: view {c + 1}",
            joints2d=joints2d[:, c],
            confidence=confidence[:, c],
            joints3d=None if joints3d is None else joints3d[:, c],
            warnings=() if n else notes,
        )
        for n, c in enumerate(_view_order(path, arrays, joints2d.shape[1], views))
    ]


def named_views(path: Path) -> tuple[str, ...]:
    """Names of views that an archive of joints lists; none where it lists or is none."""
    if path.suffix.lower() != ".npz":
        return ()
    try:
        names = read_archive(path, ("view_names",), "detections.npz").get("view_names")
    except InputError:  # whoever reads its joints says so
        return ()
    return () if names is None else tuple(str(name) for name in names.reshape(-1))


def _unread(path: Path) -> tuple[str, ...]:
    """Arrays that mean nothing here: names mistyped, or numbers that the user counts on."""
    found = other_arrays(path, _ARRAYS, "detections.npz")
    if not found:
        return ()
    some = ", ".join(one_line(name)[:40] for name in found[:6])
    return (f"{path}: holds what is not read ({some}); expected {', '.join(_ARRAYS)}",)


def _listings(
    path: Path,
    arrays: dict[str, np.ndarray],
    people: Array,
    joint_set: JointSet,
    views: Sequence[str] | None,
    notes: tuple[str, ...],
) -> list[Listing]:
    """Views of an array of several people (F, C, P, J, 3); rows without confidence are left out."""
    if people.shape[2] > MAX_PEOPLE:
        raise InputError(
            f"{path}: joints2d has {people.shape[2]} people a frame, expected at most {MAX_PEOPLE}"
        )
    left_out = f"{path}: 3D joints of several people are not read; only 2D is used"
    warnings = (left_out,) if "joints3d_mm" in arrays else ()
    there = (people[..., 2] != 0).any(-1)  # NaN counts: whoever counts broken joints tells of it
    return [
        Listing(
            f"{path}: view {c + 1}",
            joint_set,
            [list(row[kept]) for row, kept in zip(people[:, c], there[:, c], strict=True)],
            warnings if n else (*notes, *warnings),
            _video_frames(path, arrays),
        )
        for n, c in enumerate(_view_order(path, arrays, people.shape[1], views))
    ]


def _video_frames(path: Path, arrays: dict[str, np.ndarray]) -> int | None:
    count = arrays.get("video_frames")
    if count is None:
        return None
    if count.size != 1 or count.dtype.kind not in "iu" or int(count.reshape(())) < 1:
        raise InputError(f"{path}: video_frames is {count!r:.60}, expected a number of frames")
    return int(count.reshape(()))


def _numbers(path: Path, arrays: dict[str, np.ndarray], name: str) -> Array:
    array = arrays.get(name)
    if array is None:
        raise InputError(
            f"{path}: has no {name}; expected joints2d, confidence2d and optionally joints3d_mm, "
            "joint_names"
        )
    if array.dtype.kind not in "fiu":
        raise InputError(f"{path}: {name} holds {array.dtype}, expected numbers")
    if array.ndim and len(array) > MAX_FRAMES:
        raise InputError(f"{path}: {name} has {len(array)} frames, expected at most {MAX_FRAMES}")
    return array.astype(np.float64)


def _same_shape(path: Path, name: str, array: Array, expected: tuple[int, ...]) -> None:
    if array.shape != expected:
        raise InputError(
            f"{path}: {name} has shape {array.shape}, expected {expected} to go with joints2d"
        )


def _joint_set(path: Path, arrays: dict[str, np.ndarray], joints: int) -> JointSet:
    names = arrays.get("joint_names")
    if names is None:
        if joints != len(LANDMARKS):
            raise InputError(
                f"{path}: has {joints} joints and no joint_names, expected the {len(LANDMARKS)} "
                "landmarks; add joint_names"
            )
        return LANDMARKS16
    if names.dtype.kind not in "US" or names.shape != (joints,):
        raise InputError(
            f"{path}: joint_names is {names.dtype} {names.shape}, expected {joints} strings"
        )
    given = [
        str(name, "utf-8", "replace") if isinstance(name, bytes) else str(name) for name in names
    ]
    unknown = [name for name in given if canonical_name(name) not in KNOWN_JOINTS]
    if unknown:
        raise InputError(
            f"{path}: joint_names has unknown {', '.join(unknown[:8])}; expected names such as "
            f"{', '.join(LANDMARKS[:4])}, nose, mid_hip; rename or remove them"
        )
    try:
        return JointSet(f"{path.name}'s set", tuple(canonical_name(name) for name in given))
    except ValueError as error:
        raise InputError(f"{path}: joint_names: {error}; expected each joint once") from error


def _view_order(
    path: Path, arrays: dict[str, np.ndarray], count: int, views: Sequence[str] | None
) -> list[int]:
    """Positions in the file of the wanted views, by name where both sides have names."""
    names = arrays.get("view_names")
    if names is None or views is None or len(views) == 0:
        return list(range(count))
    given = [str(name) for name in names.reshape(-1)]
    if len(given) != count:
        raise InputError(f"{path}: names {len(given)} views but holds {count}")
    order = match_views(views, given)
    return list(range(count)) if order is None else order


def _check_millimetres(path: Path, joints3d: Array) -> None:
    finite = np.where(np.isfinite(joints3d), joints3d, 0)
    extent = np.linalg.norm(np.ptp(finite, axis=-2), axis=-1)
    extent = extent[extent > 0]
    if not len(extent):
        return
    size = float(np.median(extent))
    if (guess := unit_of(size)) != "millimetres":
        raise InputError(
            f"{path}: joints3d_mm spans {size:.3g}, expected a person in millimetres; it looks "
            f"like {guess}"
        )


# --- Detections as ``detections.npz``, which ``read_detections`` reads again ----------------------


def save_detections(
    path: Path,
    detections: Detections,
    views: Sequence[str] = (),
    *,
    start: int = 0,
    pixel_offset: float = 0.0,
    video_frames: int | None = None,
) -> None:
    """Write the 16 landmarks of C views.

    Args:
        path: the file, .npz.
        detections: (F, C, 16).
        views: names of the views, C.
        start: frames of the video before the first detection; written as unseen, so that frame
            numbers are those of the video.
        pixel_offset: what readers will add to pixels: ``CameraRig.pixel_offset``.
        video_frames: of the whole video, of which these may be a part; None where not known.

    Raises:
        InputError: the place cannot be written.
    """
    arrays = _seen(detections, pixel_offset)
    if detections.joints3d is not None:
        trusted = detections.trusted3d[..., None, None]
        pose = (1000 * detections.joints3d).where(trusted, float("nan"))
        arrays["joints3d_mm"] = pose
    if detections.views == 1:
        arrays, views = {name: array[:, 0] for name, array in arrays.items()}, ()
    _write(path, arrays, views, start, video_frames)


def save_candidates(
    path: Path,
    candidates: Detections,
    views: Sequence[str] = (),
    *,
    start: int = 0,
    pixel_offset: float = 0.0,
    video_frames: int | None = None,
) -> None:
    """Write people without names, (P, F, C, 16), as ``read_candidates`` reads them.

    Args:
        path: the file, .npz.
        candidates: 3D joints are left out.
        views: as of ``save_detections``, and so are the others.
        start: frames of the video before the first.
        pixel_offset: what readers will add to pixels.
        video_frames: of the whole video.

    Raises:
        InputError: the place cannot be written.
    """
    arrays = _seen(candidates, pixel_offset)
    arrays = {name: array.movedim(0, 2) for name, array in arrays.items()}
    _write(path, arrays, views, start, video_frames)


def _seen(detections: Detections, pixel_offset: float) -> dict[str, Tensor]:
    """Joints in pixels and their confidence; zero where there are none."""
    seen = detections.confidence2d[..., None] > 0
    joints2d = (detections.joints2d - pixel_offset).where(seen, 0)
    return {"joints2d": joints2d, "confidence2d": detections.confidence2d}


def _write(
    path: Path,
    arrays: Mapping[str, Tensor],
    views: Sequence[str],
    start: int,
    video_frames: int | None,
) -> None:
    """Arrays (F, ...) after frames of which nothing is known, and what readers must know."""
    stored: dict[str, NDArray[Any]] = {
        name: _padded(array, start, np.nan if name == "joints3d_mm" else 0.0)
        for name, array in arrays.items()
    }
    stored["joint_names"] = np.array(LANDMARKS)
    if views:
        stored["view_names"] = np.array(list(views))
    if video_frames is not None:
        stored["video_frames"] = np.array(video_frames)
    with writing(path) as file:
        np.savez_compressed(file, **stored)  # type: ignore[arg-type]


def _padded(values: Tensor, start: int, fill: float) -> NDArray[np.float32]:
    array = values.detach().cpu().numpy().astype(np.float32)
    before = np.full((start, *array.shape[1:]), fill, np.float32)
    return np.concatenate((before, array))
