"""Who is who: detections of several people without names, put together over views and time."""

from perfcap.detect.association.associate import Association, associate
from perfcap.detect.association.sightings import AssociationConfig
from perfcap.detect.association.tracks import BONE_NAMES, bone_lengths, tracked_bones

__all__ = [
    "BONE_NAMES",
    "Association",
    "AssociationConfig",
    "associate",
    "bone_lengths",
    "tracked_bones",
]
