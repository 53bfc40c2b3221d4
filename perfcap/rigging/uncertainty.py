"""How well measurements are known."""

from __future__ import annotations

import math

import numpy as np
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import Measurements
from perfcap.rigging.scales import LENGTHS, Scales

# by how much a body's measurements change when its surface moves out by one
_GROWTH = {"height": 2.0, "inseam": 1.0, **dict.fromkeys(("chest", "waist", "hip"), 2 * math.pi)}


def deviations(
    model: BodyModel, shape: Tensor, covariance: Tensor, edge: float = 0.0
) -> Measurements:
    """Standard deviations of a body's measurements, metres.

    Args:
        model: the body.
        shape: its coefficients, (S,).
        covariance: of them, (S, S).
        edge: deviation of where silhouettes end from where the skin does, everywhere alike: a
            girth changes by 2 pi times as much, the height at both ends, the inseam at one.
    """
    slopes = Scales(model).linearized(shape.double().numpy(force=True))[1]
    known = covariance.double().numpy(force=True)
    variance = np.einsum("ns,st,nt->n", slopes, known, slopes)
    grown = np.array([_GROWTH[name] for name in LENGTHS]) * edge
    return Measurements(*np.sqrt(variance + grown**2).tolist())
