"""Joint detections and the sets of joints they name."""

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import JOINT_SETS, LANDMARKS, JointSet, map_to_landmarks

__all__ = ["JOINT_SETS", "LANDMARKS", "Detections", "JointSet", "map_to_landmarks"]
