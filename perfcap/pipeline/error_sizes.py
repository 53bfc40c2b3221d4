"""How large errors of detections are, as residuals of a solved motion show them.

A weight should be the reciprocal of a variance. Detectors give confidences instead, and settings
state deviations for detectors as they mostly are. Residuals after a first solve tell both: the
median squared error of the joints of like confidence is their variance, whatever a confidence means
to its network, and medians do not notice exchanged limbs and outliers. They are taken in bins of
equal count, made to fall with confidence, and interpolated.

Deviations are root mean squares with the tails of a network's errors, and medians know no tails:
errors of a network are nominal at the shares of the stated variance that are constants here.
Smaller ones raise the weight. Larger ones do not lower it, because a motion that the first solve
smoothed away leaves large residuals as well.
"""

from __future__ import annotations

import torch
from torch import Tensor

_BINS = 10
_LEAST_PER_BIN = 20
_CHI2 = {2: 1.386, 3: 2.366}  # median squared norm of standard normal vectors
_NOMINAL = {2: 0.43, 3: 0.25}  # of the stated variance, by median: simulated networks
_LARGEST = 100.0  # gain: a tenth of the stated deviation


def calibrated(confidence: Tensor, squared: Tensor) -> Tensor:
    """Confidences that are reciprocals of variances, in the stated one.

    What a confidence is multiplied by is a constant: gradients reach every confidence.

    Args:
        confidence: any shape; 0 stays 0.
        squared: squared errors of 2D joints in their stated deviation, likewise.
    """
    with torch.no_grad():
        given = confidence.detach()
        seen = (given > 0) & squared.isfinite()
        if int(seen.sum()) < 2 * _LEAST_PER_BIN:
            return confidence
        own = given.clamp(min=1e-9).log()
        precision = (-_interpolate(own, *_bins(own[seen], squared[seen]))).exp()
        # the mean weight is the detector's own, but for what the gain says
        precision = precision * (given[seen].sum() / precision[seen].sum())
        precision = precision * gain(precision * squared, seen, 2)
        factor = torch.where(seen, precision / given.clamp(min=1e-9), 0.0)
    return confidence * factor


def gain(squared: Tensor, seen: Tensor, entries: int) -> float:
    """Factor on the weight of groups whose errors are smaller than nominal, from 1 on."""
    return min(max(1.0, _NOMINAL[entries] / max(variance(squared, seen, entries), 1e-9)), _LARGEST)


def variance(squared: Tensor, seen: Tensor, entries: int) -> float:
    """Median squared norm of groups of ``entries`` over that of standard normal ones; 1 if none."""
    known = squared[seen & squared.isfinite()]
    return float(known.median()) / _CHI2[entries] if len(known) >= _LEAST_PER_BIN else 1.0


def _bins(at: Tensor, squared: Tensor) -> tuple[Tensor, Tensor]:
    """Places of the bins and the logarithm of their variance, which does not rise."""
    order = at.argsort()
    parts = order.tensor_split(max(2, min(_BINS, len(order) // _LEAST_PER_BIN)))
    knots = torch.stack([at[part].mean() for part in parts])
    medians = torch.stack([squared[part].median() for part in parts])
    levels = (medians / _CHI2[2]).clamp(min=1e-9).log()
    return knots, levels.flip(0).cummax(0).values.flip(0)


def _interpolate(at: Tensor, knots: Tensor, levels: Tensor) -> Tensor:
    """Linear between knots, constant beyond them."""
    right = torch.searchsorted(knots, at.contiguous()).clamp(1, len(knots) - 1)
    low, high = knots[right - 1], knots[right]
    share = ((at - low) / (high - low).clamp(min=1e-9)).clamp(0, 1)
    return levels[right - 1] + share * (levels[right] - levels[right - 1])
