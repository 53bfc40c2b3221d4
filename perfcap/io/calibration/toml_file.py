"""``Calib*.toml`` as Pose2Sim, aniposelib and kin write it: one section a camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from perfcap.errors import InputError
from perfcap.io import files
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.spelling import lens_of, size_of
from perfcap.io.calibration.view import Array, View, make_view, to_numbers

_FREEMOCAP = "synchronized_videos"  # beside the calibration of a recording
_FAR = 100.0  # m; no camera of a capture stands that far from the origin


def read_toml(path: Path, default_sizes: Sequence[tuple[int, int]] | None = None) -> CameraRig:
    """Read ``matrix``, ``rotation`` (rotation vector), ``translation``, ``distortions``, ``size``.

    OpenCV's conventions, world to camera, metres, pixel centres at integers; views in the order
    of the file.
    """
    data = files.read_toml(path, "Calib*.toml")
    sections = {
        name: section
        for name, section in data.items()
        if isinstance(section, dict) and name != "metadata"
    }
    views = [_view(path, name, section) for name, section in sections.items()]
    note = f"{path}: is FreeMoCap's, whose lengths are millimetres; they are read as such"
    if not _in_millimetres(path, views):
        return make_rig(str(path), views, default_sizes=default_sizes)
    views = [replace(view, translation=1e-3 * view.translation) for view in views]
    rig = make_rig(str(path), views, default_sizes=default_sizes)
    return replace(rig, warnings=(*rig.warnings, note))


def _in_millimetres(path: Path, views: Sequence[View]) -> bool:
    """Whether a file lies in a recording of FreeMoCap, and its cameras are that far apart.

    FreeMoCap computes in the unit in which the side of its board's squares was typed in, for which
    its window asks in millimetres; files that were converted are left alone.
    """
    far = any(bool((np.abs(view.translation) > _FAR).any()) for view in views)
    return far and (path.parent / _FREEMOCAP).is_dir()


def _view(path: Path, name: str, section: dict[str, Any]) -> View:
    where = f"{path}: [{name}]"
    return make_view(
        where,
        str(section.get("name", name)),
        intrinsics=section.get("matrix"),
        rotation=rotation_matrix(where, section.get("rotation")),
        translation=section.get("translation"),
        distortion=lens_of(where, section),
        size=_size(where, section),
    )


def _size(where: str, section: Mapping[str, Any]) -> tuple[Any, Any]:
    size = section.get("size", [0, 0])
    if not isinstance(size, list) or len(size) != 2:
        raise InputError(f"{where}: size is {size!r}, expected [width, height]")
    return size_of(section)


def rotation_matrix(where: str, rotation: Any) -> Array | None:
    """A rotation given as a rotation vector (3) or a matrix (3, 3)."""
    if rotation is None:
        return None
    numbers = to_numbers(where, "rotation", rotation)
    if numbers.size == 3 and np.isfinite(numbers).all():
        matrix: Array = cv2.Rodrigues(numbers.reshape(3, 1))[0]
        return matrix
    return numbers
