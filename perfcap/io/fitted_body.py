"""Somebody's coefficients in a body model, with how well they are known: a result's ``body.npz``.

============== ======= ===================================================================
array          shape   what it is
============== ======= ===================================================================
``shape``      (S,)    coefficients of shape, in deviations of the model
``deviation``  (S,)    standard deviation of each
``covariance`` (S, S)  of all; ``deviation`` is the root of its diagonal
``model``      ()      name of the body model
============== ======= ===================================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.io.atomic import writing

Floats = NDArray[np.float64]
_ARRAYS = ("shape", "covariance", "model")
_WHAT = "a fitted body (.npz)"
_MOST = 512  # components


@dataclass(frozen=True, eq=False)
class FittedBody:
    """Coefficients of shape (S,), their covariance (S, S), and the name of the body model."""

    shape: Floats
    covariance: Floats
    model: str

    @property
    def deviation(self) -> Floats:
        """Of each coefficient, (S,)."""
        root: Floats = np.sqrt(np.diagonal(self.covariance))
        return root


def save_fitted_body(path: Path, body: FittedBody) -> None:
    """Write ``body.npz``."""
    with writing(path) as file:
        np.savez_compressed(
            file,
            shape=body.shape,
            deviation=body.deviation,
            covariance=body.covariance,
            model=np.array(body.model),
        )


def load_fitted_body(path: Path) -> FittedBody:
    """Read what ``save_fitted_body`` wrote.

    Raises:
        InputError: it is not such a file.
    """
    arrays = read_archive(path, _ARRAYS, _WHAT)
    missing = [name for name in _ARRAYS if name not in arrays]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; expected {_WHAT}")
    return _checked(path, arrays)


def _checked(path: Path, arrays: dict[str, NDArray[Any]]) -> FittedBody:
    shape, covariance = arrays["shape"], arrays["covariance"]
    size = shape.size
    numbers = shape.dtype.kind == covariance.dtype.kind == "f" and arrays["model"].dtype.kind == "U"
    fits = shape.ndim == 1 and 0 < size <= _MOST and covariance.shape == (size, size)
    if not numbers or not fits or not np.isfinite(shape).all() or not np.isfinite(covariance).all():
        raise InputError(
            f"{path}: has shape {shape.dtype} {shape.shape} and covariance {covariance.dtype} "
            f"{covariance.shape}; expected finite numbers (S,) and (S, S) with S up to {_MOST}, "
            "and the name of a model"
        )
    if (np.diagonal(covariance) < 0).any():
        raise InputError(f"{path}: its covariance has a negative diagonal; expected variances")
    return FittedBody(shape.astype(float), covariance.astype(float), str(arrays["model"]))
