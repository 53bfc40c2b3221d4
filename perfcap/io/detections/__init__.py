"""Detector output files to ``Detections``, and back."""

from perfcap.io.detections.npz import save_candidates, save_detections
from perfcap.io.detections.reader import CROWDED, read_candidates, read_detections

__all__ = ["CROWDED", "read_candidates", "read_detections", "save_candidates", "save_detections"]
