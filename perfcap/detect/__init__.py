"""Joint detections and the sets of joints they name."""
