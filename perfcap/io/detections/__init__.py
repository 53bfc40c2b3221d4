"""Detector output files to ``Detections``, and back."""

from perfcap.io.detections.npz import named_views, save_candidates, save_detections
from perfcap.io.detections.reader import CROWDED, read_candidates, read_detections

__all__ = [
    "CROWDED",
    "named_views",
    "read_candidates",
    "read_detections",
    "save_candidates",
    "save_detections",
]
