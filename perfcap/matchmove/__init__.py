"""The way of a camera that moves, from what it films behind a person."""

from perfcap.matchmove.bars import find_bars, picture_size
from perfcap.matchmove.camera_way import CameraWay, WaySettings, find_way
from perfcap.matchmove.corner_tracks import CornerTracks, Sightings, TrackSettings
from perfcap.matchmove.ground import Ground, GroundSettings, find_ground
from perfcap.matchmove.vertical import Sight, VerticalSettings, find_vertical
from perfcap.matchmove.zoom import find_zoom

__all__ = [
    "CameraWay",
    "CornerTracks",
    "Ground",
    "GroundSettings",
    "Sight",
    "Sightings",
    "TrackSettings",
    "VerticalSettings",
    "WaySettings",
    "find_bars",
    "find_ground",
    "find_vertical",
    "find_way",
    "find_zoom",
    "picture_size",
]
