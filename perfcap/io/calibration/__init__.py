"""Camera files to rigs of calibrated views."""

from perfcap.io.calibration.assumed import assumed_rig
from perfcap.io.calibration.pixel_map import PixelMap, match_image, read_pixel_map
from perfcap.io.calibration.reader import files_beside, read_cameras
from perfcap.io.calibration.rig import CameraRig

__all__ = [
    "CameraRig",
    "PixelMap",
    "assumed_rig",
    "files_beside",
    "match_image",
    "read_cameras",
    "read_pixel_map",
]
