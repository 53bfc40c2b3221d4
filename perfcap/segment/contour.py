"""The boundary of a mask, sub-pixel, with normals.

The pixels along a boundary are a staircase. Each point is the local quadratic fit to its
neighbours along the boundary, with Gaussian weights, moved outward by half a pixel's extent along
the normal: where an ideal edge would have to run, on average, to make that staircase. The
quadratic keeps circles from shrinking, which plain smoothing would.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.setting_checks import Settings

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
# Trust in contour points: a picture (H, W) to look it up in, or a function of points and normals.
Confidence = NDArray[np.floating] | Callable[[Floats, Floats], Floats]

_SHORTEST = 8  # pixels around an island; a quadratic needs neighbours
_SPAN = 2.5  # standard deviations after which neighbours no longer count


@dataclass(frozen=True)
class Contour:
    """Boundary of a silhouette in one frame and view.

    Attributes:
        points: (N, 2) px, between the centres of inside and outside pixels; one after the other
            along each closed piece of the boundary, about 1.2 px apart.
        normals: (N, 2), unit, outward.
        confidence: (N,), 0 to 1.
    """

    points: Floats
    normals: Floats
    confidence: Floats

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, chosen: Flags | Integers | slice) -> Contour:
        """Some of the points."""
        return Contour(self.points[chosen], self.normals[chosen], self.confidence[chosen])


@dataclass(frozen=True)
class Tracing(Settings):
    """How a contour is drawn through a mask.

    Attributes:
        reach: standard deviation of the weights of neighbours along the boundary, in pixels of it;
            larger is smoother and rounds corners more.
        smallest: islands and holes of less area are dropped, as a share of the mask's.
    """

    reach: float = 3.0
    smallest: float = 5e-4


def extract_contour(
    mask: NDArray[np.generic],
    confidence: Confidence | None = None,
    settings: Tracing | None = None,
) -> Contour:
    """Sub-pixel boundary of a mask, of its holes too.

    Args:
        mask: (H, W), bool, or whole numbers that count as inside where not zero.
        confidence: (H, W) in [0, 1], or a function of points (N, 2) and normals (N, 2); 1 when
            not given.
        settings: smoothing and the least size.

    Returns:
        The contour; empty for a mask that is empty or full. What ends at the image border is cut
        off there by the image, not by the person, and has no points within a few pixels of it.

    Raises:
        InputError: the mask is no picture, or a soft one, or the confidence does not fit it.
    """
    settings = settings if settings is not None else Tracing()
    if mask.ndim != 2:
        raise InputError(f"mask has shape {mask.shape}; expected one picture (H, W)")
    inside = np.ascontiguousarray(mask, np.bool_).view(np.uint8)
    _require_whole(mask)
    chains = _chains(inside, settings.smallest)
    parts = [_smooth(chain, inside.shape, settings.reach) for chain in chains]
    points = np.concatenate([np.zeros((0, 2)), *(part[0] for part in parts)])
    normals = np.concatenate([np.zeros((0, 2)), *(part[1] for part in parts)])
    return Contour(points, normals, _trust(points, normals, confidence, mask.shape))


def _require_whole(mask: NDArray[np.generic]) -> None:
    """Refuse masks of fractions, log odds or NaN: whatever is not quite zero would be inside."""
    if mask.dtype.kind != "f" or not mask.size:
        return
    low, high = float(mask.min()), float(mask.max())
    if not low >= 0 or not np.isin(mask, (0, high)).all():
        raise InputError(
            f"mask is {mask.dtype} of {low:.3g} to {high:.3g}; expected bool, or whole numbers, 0 "
            "outside: compare soft masks with a half, as mask > 0.5, and log odds with 0"
        )


def _chains(inside: NDArray[np.uint8], smallest: float) -> list[Integers]:
    """Inside pixels along each boundary, outer ones and holes, (n, 2), 8-connected."""
    left, top, width, height = cv2.boundingRect(inside)
    if not width or not height:
        return []
    window = inside[top : top + height, left : left + width]
    found, _ = cv2.findContours(window, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE, offset=(left, top))
    least = smallest * cv2.countNonZero(window)
    kept = [chain[:, 0] for chain in found if cv2.contourArea(chain) >= least]
    return [chain.astype(np.int64) for chain in kept if len(chain) >= _SHORTEST]


def _smooth(chain: Integers, size: tuple[int, ...], reach: float) -> tuple[Floats, Floats]:
    """Points and outward normals along a closed chain of pixels, those at the border left out."""
    # a small island has no neighbours further than half way around
    half = min(max(round(_SPAN * reach), 1), (len(chain) - 1) // 2)
    position, slope = _filters(half, reach)
    border = (chain == 0).any(1) | (chain == np.array([size[1] - 1, size[0] - 1])).any(1)
    around = np.concatenate([chain[-half:], chain, chain[:half]]).astype(np.float64)
    points = np.stack([np.convolve(around[:, k], position, "valid") for k in range(2)], 1)
    along = np.stack([np.convolve(around[:, k], slope, "valid") for k in range(2)], 1)
    near = np.convolve(np.concatenate([border[-half:], border, border[:half]]), slope != 0, "valid")
    length = np.linalg.norm(along, axis=1, keepdims=True)
    # findContours walks with the outside on the same hand around islands and holes
    normals = np.stack([-along[:, 1], along[:, 0]], 1) / np.maximum(length, 1e-12)
    # along the steeper axis, boundary pixels lie evenly between 0 and 1 px inside an ideal edge
    points += 0.5 * np.abs(normals).max(1, keepdims=True) * normals
    kept = (near == 0) & (length[:, 0] > 1e-6)
    return points[kept], normals[kept]


def _filters(half: int, reach: float) -> tuple[Floats, Floats]:
    """Value and slope at 0 of the weighted quadratic through ``2 half + 1`` neighbours."""
    offset = np.arange(-half, half + 1, dtype=np.float64)
    basis = np.stack([np.ones_like(offset), offset, offset**2], 1)
    weighted = basis * np.exp(-0.5 * (offset / reach) ** 2)[:, None]
    fit = np.linalg.solve(basis.T @ weighted, weighted.T)
    return fit[0], -fit[1]  # a convolution turns the slope's filter around


def _trust(
    points: Floats, normals: Floats, confidence: Confidence | None, size: tuple[int, ...]
) -> Floats:
    if confidence is None:
        return np.ones(len(points))
    if callable(confidence):
        values = np.asarray(confidence(points, normals), np.float64)
    elif confidence.shape == size:
        column, row = np.rint(points).astype(np.int64).T
        row, column = row.clip(0, size[0] - 1), column.clip(0, size[1] - 1)
        values = confidence[row, column].astype(np.float64)
    else:
        raise InputError(f"confidence has shape {confidence.shape}; expected the mask's {size}")
    if values.shape != (len(points),) or not ((values >= 0) & (values <= 1)).all():
        raise InputError(
            f"confidence gives shape {values.shape} and values outside 0 to 1 or not numbers; "
            f"expected {len(points)} values in [0, 1]"
        )
    return values
