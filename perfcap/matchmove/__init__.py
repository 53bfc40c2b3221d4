"""The way of a camera that moves, from what it films behind a person."""

from perfcap.matchmove.camera_way import CameraWay, WaySettings, find_way
from perfcap.matchmove.corner_tracks import CornerTracks, Sightings, TrackSettings

__all__ = [
    "CameraWay",
    "CornerTracks",
    "Sightings",
    "TrackSettings",
    "WaySettings",
    "find_way",
]
