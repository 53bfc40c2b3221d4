"""Joint detections, the sets of joints they name, and networks that detect."""

from perfcap.detect.association import Association, associate
from perfcap.detect.crop import Crop
from perfcap.detect.detections import Detections
from perfcap.detect.heatmap import HeatmapHead, soft_argmax
from perfcap.detect.joint_set import JOINT_SETS, LANDMARKS, JointSet, map_to_landmarks
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.people import OnnxFinder
from perfcap.detect.segmenter import OnnxSegmenter
from perfcap.detect.session import Execution

__all__ = [
    "JOINT_SETS",
    "LANDMARKS",
    "Association",
    "Crop",
    "Detections",
    "Execution",
    "HeatmapHead",
    "JointSet",
    "OnnxDetector",
    "OnnxFinder",
    "OnnxSegmenter",
    "associate",
    "map_to_landmarks",
    "soft_argmax",
]
