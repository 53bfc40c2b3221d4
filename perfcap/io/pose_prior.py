"""Pose priors: ``prior.npz`` with a mixture of Gaussians over named joint angles.

Arrays: ``angle_names`` (A,), ``share`` (K,), ``mean`` (K, A) radians, and ``precision`` (K, A, A),
lower Cholesky factors of the inverse covariances.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.actor.pose_statistics import Mixture
from perfcap.errors import InputError
from perfcap.io.actor import models_folder
from perfcap.io.archive import read_archive
from perfcap.io.atomic import writing

DEFAULT_PRIOR = "cmu"
_FILE, _WHAT = "prior.npz", "a pose prior (.npz)"
_ARRAYS = ("angle_names", "share", "mean", "precision")
_MOST = 256  # components and angles


def load_pose_prior(name: str | Path = DEFAULT_PRIOR) -> Mixture:
    """A shipped pose prior by name, or a file; in float64.

    Raises:
        InputError: there is none, or it cannot be used.
    """
    path = Path(name)
    path = path if path.is_file() else models_folder() / "priors" / path.name / _FILE
    arrays = read_archive(path, _ARRAYS, _WHAT)
    missing = [key for key in _ARRAYS if key not in arrays]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; expected {_WHAT}")
    numbers = [arrays[key] for key in _ARRAYS[1:]]
    sound = all(n.dtype.kind == "f" and np.isfinite(n).all() for n in numbers)
    dims = [n.ndim for n in numbers] == [1, 2, 3] and max(numbers[1].shape) <= _MOST
    if not sound or not dims or arrays["angle_names"].dtype.kind != "U":
        shapes = {key: arrays[key].shape for key in _ARRAYS}
        raise InputError(f"{path}: holds {shapes}; expected finite (A,), (K,), (K, A), (K, A, A)")
    names = tuple(str(each) for each in arrays["angle_names"].ravel())
    return Mixture(names, *(torch.from_numpy(n.astype(np.float64)) for n in numbers))


def save_pose_prior(
    path: Path,
    names: Sequence[str],
    share: NDArray[np.float64],
    mean: NDArray[np.float64],
    precision: NDArray[np.float64],
) -> None:
    """Write ``prior.npz``; numbers as float32, which is finer than what they are known to."""
    with writing(path) as file:
        np.savez_compressed(
            file,
            angle_names=np.array(list(names)),
            share=share,
            mean=mean.astype(np.float32),
            precision=precision.astype(np.float32),
        )
