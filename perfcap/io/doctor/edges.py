"""2D joints that were moved to the edge of the image, as clipping of coordinates does."""

from __future__ import annotations

from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity

_BESIDE = 1.5  # px from an edge
_FEWEST, _SHARE = 8, 0.03  # joints on one line at an edge, and share of all
_SPREAD = 5.0  # px, about which they lie along it: placeholders are at one place


def examine_edges(subject: str, pixels: Tensor, size: tuple[int, int]) -> list[Finding]:
    """Joints with one coordinate that is that of an edge to the last digit.

    Args:
        subject: of the finding.
        pixels: joints that are seen, (N, 2).
        size: height and width of the image.
    """
    height, width = size
    found = []
    if len(pixels) < _FEWEST:
        return []
    for axis, limit, names in (
        (0, width - 1, ("left", "right")),
        (1, height - 1, ("top", "lower")),
    ):
        ends = (pixels[:, axis].amin(), 0), (pixels[:, axis].amax(), limit)
        for (place, edge), name in zip(ends, names, strict=True):
            along = pixels[pixels[:, axis] == place, 1 - axis]
            many = len(along) >= max(_FEWEST, _SHARE * len(pixels))
            if abs(float(place) - edge) <= _BESIDE and many and float(along.std()) > _SPREAD:
                found.append(f"{len(along)} joints with confidence lie on the {name} edge")
    if not found:
        return []
    what = f"{', '.join(found)} to the last digit, as where coordinates were cut off there"
    remedy = "give confidence 0 to joints outside of the image, or their places outside"
    return [Finding(Severity.WARNING, subject, what, remedy)]
