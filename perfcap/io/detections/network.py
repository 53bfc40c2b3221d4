"""What networks that predict a body say of each frame, under the names that they use themselves.

Two families, as arrays of an npz or lists of a JSON file, one person:

- SAM 3D Body (its ``process_one_image``): ``pred_keypoints_3d`` (F, 70, 3) m about the body's own
  origin, ``pred_cam_t`` (F, 3) m, ``pred_keypoints_2d`` (F, 70, 2) pixels of the image, and
  ``focal_length`` (F,) px, which is told and otherwise not needed.
- those with SMPL's or SMPL-X's joints, such as GVHMR and WHAM: ``smpl_joints`` (F, J, 3) m in the
  axes of the camera (x right, y down, z forward), of which the first 22 are read; ``camera`` K,
  (3, 3) or (F, 3, 3) px; and the crown of the head, which joints do not show: ``head_top`` (F, 3),
  or ``smpl_vertices`` (F, V, 3) in which it is found.

``frame_ids`` (F,) says which frames of the video the rows are, counted from 0; without, they are
all of them. Rows that are not finite are nobody. The programs write pickles, which are not read:
docs/coming_from.md has the lines that convert them.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.detect.detections import unit_of
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16, JointSet
from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.io.detections.track import MAX_FRAMES, Array, Track

PICKLES = frozenset({".pkl", ".pickle", ".pt", ".pth", ".joblib", ".ckpt"})

_MHR, _SMPL = "pred_keypoints_3d", "smpl_joints"
_MHR_ARRAYS = (_MHR, "pred_cam_t", "pred_keypoints_2d", "focal_length")
_SMPL_ARRAYS = (_SMPL, "camera", "head_top", "smpl_vertices")
_NAMES = (*_MHR_ARRAYS, *_SMPL_ARRAYS, "frame_ids")
_WHAT = "what a network says of a body in each frame"

# MHR's 70 points: those of them that are joints of ours, and their places
_MHR_PLACES = (*range(21), 41, 62, 69)
_MHR_SET = JointSet(
    "MHR-70",
    (
        "nose",
        *(f"{side}_{name}" for name in ("eye", "ear", "shoulder", "elbow") for side in "lr"),
        *(f"{side}_{name}" for name in ("hip", "knee", "ankle") for side in "lr"),
        *(f"{side}_{name}" for side in "lr" for name in ("big_toe", "small_toe", "heel")),
        *("r_wrist", "l_wrist", "neck"),
    ),
)
_MHR_JOINTS = 70
_SMPL_BODY = 22  # joints that SMPL and SMPL-X share
# SMPL's joints that are our landmarks, the crown aside
_SMPL_PLACES = {
    "neck": 12,
    **{"l_shoulder": 16, "r_shoulder": 17, "l_elbow": 18, "r_elbow": 19},
    **{"l_wrist": 20, "r_wrist": 21, "l_hip": 1, "r_hip": 2, "l_knee": 4, "r_knee": 5},
    **{"l_ankle": 7, "r_ankle": 8, "l_toe": 10, "r_toe": 11},
}
_HEAD, _NECK = 15, 12
_CROWN_REACH = 0.35  # m from the joint of the head; hands above it are farther off or lower
_FARTHEST = 1e6  # px or m; squares of larger numbers overflow
_NEAREST = 0.05  # m in front of the camera


def holds_network(path: Path) -> bool:
    """Whether an archive has arrays of a network; False for what is no archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = set(archive.namelist())
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError):
        return False
    return bool(names & {f"{_MHR}.npy", f"{_SMPL}.npy"})


def read_network_npz(path: Path, frames: int | None = None) -> Track:
    """Read arrays of a network; see ``read_network``."""
    return read_network(path, read_archive(path, _NAMES, _WHAT), frames)


def read_network_json(path: Path, data: Mapping[str, Any], frames: int | None = None) -> Track:
    """Read the same as lists; see ``read_network``."""
    arrays = {}
    for name in _NAMES:
        if name in data:
            arrays[name] = _listed(path, name, data[name])
    return read_network(path, arrays, frames)


def is_network_json(data: Any) -> bool:
    """Whether a JSON value has the lists of a network."""
    return isinstance(data, dict) and bool({_MHR, _SMPL} & set(data))


def read_network(path: Path, arrays: Mapping[str, Array], frames: int | None = None) -> Track:
    """One person's joints in the image, and in space in the axes of the camera.

    Args:
        path: of the file, for messages.
        arrays: by the names above.
        frames: of the video, where known, for rows that are of some of its frames.

    Raises:
        InputError: an array that is missing, or of another shape, kind or unit.
    """
    if _MHR in arrays:
        joint_set, pixels, points, note = _sam(path, arrays)
    else:
        joint_set, pixels, points, note = _smpl(path, arrays)
    _check_metres(path, points)
    there = _finite(points) & _finite(pixels)
    confidence = np.broadcast_to(there[:, None], pixels.shape[:2]).astype(np.float64)
    points = points - _root(points, joint_set)
    rows = _rows(path, arrays, len(points))
    if rows is not None:
        count = max(int(rows.max()) + 1, frames or 0)
        pixels, confidence, points = (_spread(v, rows, count) for v in (pixels, confidence, points))
    empty = confidence == 0
    return Track(
        str(path),
        joint_set,
        np.where(empty[..., None], 0.0, pixels),
        confidence,
        np.where(empty[..., None], np.nan, points),
        note,
    )


def _sam(path: Path, arrays: Mapping[str, Array]) -> tuple[JointSet, Array, Array, tuple[str, ...]]:
    joints = _array(path, arrays, _MHR, (None, _MHR_JOINTS, 3))
    shift = _array(path, arrays, "pred_cam_t", (len(joints), 3))
    pixels = _array(path, arrays, "pred_keypoints_2d", (len(joints), _MHR_JOINTS, 2))
    chosen = list(_MHR_PLACES)
    points = joints[:, chosen] + shift[:, None]
    note: tuple[str, ...] = ()
    if "focal_length" in arrays:
        focal = _numbers(path, arrays, "focal_length").reshape(-1)
        known = focal[(focal > 0) & (focal < _FARTHEST)]
        if len(known):
            note = (f"{path}: was made with a focal length of {np.median(known):.0f} px",)
    return _MHR_SET, pixels[:, chosen] - 0.5, points, note  # theirs count from the corner


def _smpl(
    path: Path, arrays: Mapping[str, Array]
) -> tuple[JointSet, Array, Array, tuple[str, ...]]:
    joints = _array(path, arrays, _SMPL, (None, None, 3))
    if joints.shape[1] < _SMPL_BODY:
        raise InputError(
            f"{path}: {_SMPL} has {joints.shape[1]} joints, expected SMPL's 24 or SMPL-X's, of "
            f"which the first {_SMPL_BODY} are the body's"
        )
    crown = _crown(path, arrays, joints)
    columns = [crown if n == "head_top" else joints[:, _SMPL_PLACES[n]] for n in LANDMARKS]
    points = np.stack(columns, 1)
    camera = _numbers(path, arrays, "camera")
    if camera.shape not in ((3, 3), (len(joints), 3, 3)):
        raise InputError(
            f"{path}: camera has shape {camera.shape}, expected K, (3, 3), or one a frame, "
            f"({len(joints)}, 3, 3)"
        )
    k = np.broadcast_to(camera, (len(joints), 3, 3))
    focal = k[:, [0, 1], [0, 1]]
    if not ((np.abs(k) < _FARTHEST).all() and (focal > 1).all()):
        raise InputError(f"{path}: camera holds no focal lengths; expected K in pixels")
    if (points[..., 2] < _NEAREST).any():  # never of NaN
        raise InputError(
            f"{path}: {_SMPL} has joints behind the camera; expected them in its axes, x right, "
            "y down, z forward, in metres (GVHMR's smpl_params_incam, not its global ones)"
        )
    projected = np.einsum("fij,fnj->fni", k, points)
    pixels = projected[..., :2] / projected[..., 2:] - 0.5  # networks count from the corner
    angle = _field_of_view(k[0])
    note = f"{path}: its camera sees {angle:.1f} degrees across the longer side; --fov {angle:.1f}"
    return LANDMARKS16, pixels, points, (f"{note} assumes the same, where cameras are not known",)


def _crown(path: Path, arrays: Mapping[str, Array], joints: Array) -> Array:
    """The top of the head, (F, 3): given, or the vertex that is farthest along the head."""
    if "head_top" in arrays:
        return _array(path, arrays, "head_top", (len(joints), 3))
    if "smpl_vertices" not in arrays:
        raise InputError(
            f"{path}: has neither head_top nor smpl_vertices, and SMPL's joints do not show the "
            "crown of the head; add one of them"
        )
    vertices = _array(path, arrays, "smpl_vertices", (len(joints), None, 3))
    head = joints[:, _HEAD, None]
    along = joints[:, _HEAD] - joints[:, _NECK]
    from_head = vertices - head
    near = np.linalg.norm(from_head, axis=-1) < _CROWN_REACH
    height = np.where(near, np.einsum("fvi,fi->fv", from_head, along), -np.inf)
    crown: Array = vertices[np.arange(len(joints)), height.argmax(1)]
    return crown


def _field_of_view(k: Array) -> float:
    """Degrees across the longer side of an image whose middle is the principal point."""
    return math.degrees(2 * math.atan(max(k[0, 2] / k[0, 0], k[1, 2] / k[1, 1])))


def _root(points: Array, joint_set: JointSet) -> Array:
    hips = [joint_set.joints.index(name) for name in ("r_hip", "l_hip")]
    root: Array = points[:, hips].mean(1, keepdims=True)
    return root


def _rows(path: Path, arrays: Mapping[str, Array], count: int) -> np.ndarray | None:
    """Frames of the video that the rows are of; None where they are all of them."""
    if "frame_ids" not in arrays:
        return None
    found = _numbers(path, arrays, "frame_ids").reshape(-1)
    whole = len(found) == count and np.isfinite(found).all() and (found == found.round()).all()
    if not whole or found.min(initial=0) < 0 or found.max(initial=0) >= MAX_FRAMES:
        raise InputError(f"{path}: frame_ids are {len(found)}, expected {count} frames from 0")
    if len(np.unique(found)) != count:
        raise InputError(f"{path}: frame_ids name a frame twice; expected each once")
    return found.astype(np.int64)


def _spread(values: Array, rows: np.ndarray, count: int) -> Array:
    spread = np.zeros((count, *values.shape[1:]))
    spread[rows] = values
    return spread


def _finite(values: Array) -> NDArray[np.bool_]:
    """Rows (F, J, k) that are finite throughout."""
    found: NDArray[np.bool_] = np.all(np.isfinite(values), axis=(1, 2))
    return found


def _check_metres(path: Path, points: Array) -> None:
    finite = points[_finite(points)]
    if not len(finite):
        raise InputError(f"{path}: holds nobody in any frame; expected a visible person")
    size = float(np.median(np.linalg.norm(np.ptp(finite, axis=1), axis=-1)))
    if (guess := unit_of(size)) != "metres":
        raise InputError(
            f"{path}: joints span {size:.3g}, expected a person in metres; it looks like {guess}"
        )


def _array(
    path: Path, arrays: Mapping[str, Array], name: str, shape: tuple[int | None, ...]
) -> Array:
    values = _numbers(path, arrays, name)
    if values.ndim == len(shape) + 1 and values.shape[1] == 1:
        values = values[:, 0]  # one person
    fits = values.ndim == len(shape) and all(
        want in (None, have) for have, want in zip(values.shape, shape, strict=True)
    )
    if not fits or 0 in values.shape:
        listed = ", ".join("any" if size is None else str(size) for size in shape)
        raise InputError(f"{path}: {name} has shape {values.shape}, expected ({listed})")
    if len(values) > MAX_FRAMES:
        raise InputError(f"{path}: {name} has {len(values)} frames, at most {MAX_FRAMES}")
    return np.where(np.abs(values) < _FARTHEST, values, np.nan)


def _numbers(path: Path, arrays: Mapping[str, Array], name: str) -> Array:
    values = arrays.get(name)
    if values is None:
        raise InputError(f"{path}: has no {name}; expected it beside the joints of the network")
    if values.dtype.kind not in "fiu":
        raise InputError(f"{path}: {name} holds {values.dtype}, expected numbers")
    return values.astype(np.float64)


def _listed(path: Path, name: str, value: Any) -> Array:
    try:
        return np.array(value, dtype=np.float64)
    except (ValueError, TypeError, OverflowError):
        raise InputError(
            f"{path}: {name} is no list of numbers of one shape; write null as NaN"
        ) from None
