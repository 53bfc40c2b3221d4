"""``volume.npz``: the Gaussians of a body, for trackers that use them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.actor.volume import Volume
from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.io.atomic import writing

_WHAT = "a volume (volume.npz)"
_MOST = 100_000  # Gaussians
# kinds of numbers or texts, how many axes they have, and what that is
_KINDS = {
    "centres": ("f", 2, "numbers (Q, 3)"),
    "deviations": ("f", 1, "numbers (Q,)"),
    "densities": ("f", 1, "numbers (Q,)"),
    "joints": ("iu", 1, "whole numbers (Q,)"),
    "joint_names": ("U", 1, "texts (J,)"),
    "colours": ("f", 2, "numbers (Q, 3)"),
}


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
    arrays = read_archive(path, tuple(_KINDS), _WHAT)
    missing = [name for name in _KINDS if name not in arrays and name != "colours"]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; expected {_WHAT}")
    _require_kinds(path, arrays)
    names, joints, colors = arrays["joint_names"], arrays["joints"], arrays.get("colours")
    floats = [arrays[name] for name in ("centres", "deviations", "densities")]
    if any(not np.isfinite(each).all() for each in floats):
        raise InputError(f"{path}: centres, deviations or densities are not finite numbers")
    if colors is not None and np.isinf(colors).any():
        raise InputError(f"{path}: colours are not finite numbers, nor NaN where nothing was seen")
    least = floats[1].min(initial=np.inf)
    if len(joints) > _MOST or not least > 0 or not (floats[2] >= 0).all():
        raise InputError(
            f"{path}: has {len(joints)} Gaussians of deviations from {least:.3g} m; "
            f"expected at most {_MOST}, wider than nothing and not less dense"
        )
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


def _require_kinds(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    for name, array in arrays.items():
        kinds, axes, expected = _KINDS[name]
        if array.dtype.kind not in kinds or array.ndim != axes:
            raise InputError(f"{path}: {name} are {array.dtype} {array.shape}; expected {expected}")
