"""Images and a posed model to silhouettes, contours and correspondences."""

from perfcap.segment.contour import Contour, Tracing, extract_contour
from perfcap.segment.correspondence import Correspondences, Matches, stack
from perfcap.segment.edge_field import EdgeField, EdgeSettings, find_edges
from perfcap.segment.grabcut import FrameReport, Segmentation
from perfcap.segment.matching import Matching, match
from perfcap.segment.scene import Scene, survey
from perfcap.segment.sequence import Footage, SequenceSettings, segment_block
from perfcap.segment.silhouettes import Silhouettes

__all__ = [
    "Contour",
    "Correspondences",
    "EdgeField",
    "EdgeSettings",
    "Footage",
    "FrameReport",
    "Matches",
    "Matching",
    "Scene",
    "Segmentation",
    "SequenceSettings",
    "Silhouettes",
    "Tracing",
    "extract_contour",
    "find_edges",
    "match",
    "segment_block",
    "stack",
    "survey",
]
