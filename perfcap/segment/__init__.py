"""Images and a posed model to silhouettes, contours and correspondences."""

from perfcap.segment.contour import Contour, Tracing, extract_contour
from perfcap.segment.correspondence import Correspondences, Matches, stack

__all__ = ["Contour", "Correspondences", "Matches", "Tracing", "extract_contour", "stack"]
