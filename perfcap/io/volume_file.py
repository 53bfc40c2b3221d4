"""``volume.npz``: the Gaussians of a body, for trackers that use them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from perfcap.actor.volume import Volume
from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.io.atomic import writing

_ARRAYS = ("centres", "deviations", "densities", "joints", "joint_names")
_WHAT = "a volume (volume.npz)"
_MOST = 100_000  # Gaussians


def save_volume(path: Path, volume: Volume, joints: Sequence[str]) -> None:
    """Write a volume; see ``load_volume``."""
    count = volume.count
    colors = torch.full((count, 3), torch.nan) if volume.colors is None else volume.colors
    with writing(path) as file:
        np.savez_compressed(
            file,
            centres=volume.centres.double().numpy(force=True),
            deviations=volume.deviations.double().numpy(force=True),
            densities=volume.densities.double().numpy(force=True),
            colours=colors.double().numpy(force=True),
            joints=volume.joints.numpy(force=True),
            joint_names=np.array(list(joints)),
        )


def load_volume(path: Path) -> tuple[Volume, tuple[str, ...]]:
    """Gaussians and the names of the joints that they count, in float64.

    Arrays: ``centres`` (Q, 3) m in the rest pose, ``deviations`` (Q,) m, ``densities`` (Q,) 1/m,
    ``colours`` (Q, 3) linear RGB (NaN where nothing was seen; may be missing), ``joints`` (Q,) and
    ``joint_names`` (J,).

    Raises:
        InputError: the file is missing, damaged, or holds something else.
    """
    arrays = read_archive(path, (*_ARRAYS, "colours"), _WHAT)
    missing = [name for name in _ARRAYS if name not in arrays]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; expected {_WHAT}")
    names, joints = arrays["joint_names"], arrays["joints"]
    if names.dtype.kind != "U" or names.ndim != 1 or joints.dtype.kind not in "iu":
        raise InputError(
            f"{path}: joint_names hold {names.dtype} and joints {joints.dtype}; expected texts and "
            "whole numbers"
        )
    floats = [arrays[name] for name in _ARRAYS[:3]]
    if any(each.dtype.kind != "f" or not np.isfinite(each).all() for each in floats):
        raise InputError(f"{path}: centres, deviations or densities are not finite numbers")
    if len(joints) > _MOST or not (floats[1] > 0).all() or not (floats[2] >= 0).all():
        raise InputError(
            f"{path}: has {len(joints)} Gaussians of deviations from {floats[1].min():.3g} m; "
            f"expected at most {_MOST}, wider than nothing and not less dense"
        )
    colors = arrays.get("colours")
    if len(joints) and not (joints.min() >= 0 and joints.max() < len(names)):
        raise InputError(f"{path}: joints name {int(joints.max())} of {len(names)} joints")
    centres, deviations, densities = (torch.from_numpy(each.astype(np.float64)) for each in floats)
    volume = Volume(
        centres,
        deviations,
        densities,
        torch.from_numpy(joints.astype(np.int64)),
        None if colors is None else torch.from_numpy(np.asarray(colors, np.float64)),
    )
    return volume, tuple(str(name) for name in names)
