"""Images and a posed model to silhouettes, contours and correspondences."""

from perfcap.segment.contour import Contour, Tracing, extract_contour
from perfcap.segment.correspondence import Correspondences, Matches, stack
from perfcap.segment.matching import Matching, match

__all__ = [
    "Contour",
    "Correspondences",
    "Matches",
    "Matching",
    "Tracing",
    "extract_contour",
    "match",
    "stack",
]
