"""What the peak of a heat map is worth: the share of such joints that are found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.detect.manifest import Calibration

_KNOTS = 9


def fit_calibration(
    peaks: NDArray[np.float64], found: NDArray[np.bool_], knots: int = _KNOTS
) -> Calibration:
    """The monotone map from peaks (N,) to the probability that a joint is found (N,).

    Isotonic regression by pooling neighbours that are in the wrong order (Barlow and others
    1972), read at quantiles of the peaks. Nothing is promised below the smallest peak: 0 there.
    """
    order = np.argsort(peaks, kind="stable")
    raw, hit = peaks[order].astype(np.float64), found[order].astype(np.float64)
    level, weight = _pooled(hit)
    fitted = np.repeat(level, weight.astype(int))
    inner = np.linspace(0, len(raw) - 1, knots).round().astype(int)
    places = np.concatenate([[0.0], raw[inner]])
    values = np.concatenate([[0.0], fitted[inner]])
    keep = np.concatenate([[True], np.diff(places) > 1e-6])
    return Calibration(tuple(float(v) for v in places[keep]), tuple(float(v) for v in values[keep]))


def _pooled(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means and sizes of the blocks of the rising sequence nearest to values."""
    means: list[float] = []
    sizes: list[float] = []
    for value in values:
        means.append(float(value))
        sizes.append(1.0)
        while len(means) > 1 and means[-2] >= means[-1]:
            size = sizes[-2] + sizes[-1]
            mean = (means[-2] * sizes[-2] + means[-1] * sizes[-1]) / size
            means[-2:], sizes[-2:] = [mean], [size]
    return np.array(means), np.array(sizes)


def expected_error(
    peaks: NDArray[np.float64],
    found: NDArray[np.bool_],
    calibration: Calibration,
    bins: int = 10,
) -> float:
    """Mean gap between what is promised and what is found (Naeini et al. 2015), 0 to 1."""
    confidence = np.interp(peaks, calibration.raw, calibration.probability)
    index = np.minimum((confidence * bins).astype(int), bins - 1)
    gap = 0.0
    for row in range(bins):
        here = index == row
        if here.any():
            gap += here.mean() * abs(float(confidence[here].mean()) - float(found[here].mean()))
    return gap
