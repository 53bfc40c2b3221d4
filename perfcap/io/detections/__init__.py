"""Detector output files to ``Detections``."""

from perfcap.io.detections.reader import read_detections

__all__ = ["read_detections"]
