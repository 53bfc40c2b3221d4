"""Whether 2D joints and their confidences are some; else they are refused."""

from __future__ import annotations

from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.errors import InputError

_NORMALISED = 2.0  # pixels: nobody is so small
_ROUNDING = 1e-3


def require_joints(detections: Detections) -> None:
    """Refuse 2D joints that are no pixels; those that are not finite count as unseen.

    Raises:
        InputError: all joints lie within two pixels, or a confidence is below 0 or above 1.
    """
    require_shares(detections.confidence2d)
    require_pixels(detections)


def require_pixels(detections: Detections) -> None:
    """Refuse 2D joints that are no pixels, whatever weights their confidences are.

    Raises:
        InputError: all joints that count lie within two pixels.
    """
    seen = detections.joints2d[detections.confidence2d > 0]
    if len(seen) and bool((seen.abs() <= _NORMALISED).all()):
        raise InputError(
            f"detections have joints2d of {float(seen.abs().max()):.3g} at most, expected pixels; "
            "multiply normalised joints by the size of the image"
        )


def require_shares(confidence: Tensor) -> None:
    """Refuse confidences of any shape that are not from 0 to 1; some may be no numbers.

    Raises:
        InputError: they are not.
    """
    if bool(((confidence < -_ROUNDING) | (confidence > 1 + _ROUNDING)).any()):
        found = confidence[~confidence.isnan()]
        raise InputError(
            f"confidences are {float(found.min()):.3g} to {float(found.max()):.3g}, expected 0 to "
            "1: divide percents by 100, and take the sigmoid of logits"
        )
