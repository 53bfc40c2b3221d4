"""Who is who: detections of several people without names, put together over views and time."""

from perfcap.detect.association.associate import Association, associate
from perfcap.detect.association.bones import BONE_NAMES, bone_lengths, tracked_bones
from perfcap.detect.association.config import AssociationConfig

__all__ = [
    "BONE_NAMES",
    "Association",
    "AssociationConfig",
    "associate",
    "bone_lengths",
    "tracked_bones",
]
