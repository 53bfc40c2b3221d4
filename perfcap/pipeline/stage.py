"""The stages of a capture, in order."""

from __future__ import annotations

import enum


class Stage(enum.IntEnum):
    """How far a capture goes; a later stage includes the earlier ones."""

    INITIALIZE = 0  # every frame on its own
    TRACK_MOTION = 1  # windows with a temporal prior
