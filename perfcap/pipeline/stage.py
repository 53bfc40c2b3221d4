"""The stages of a capture, in order."""

from __future__ import annotations

import enum


class Stage(enum.IntEnum):
    """How far a capture goes; a later stage includes the earlier ones."""

    INITIALIZE = 0  # every frame on its own
    TRACK_MOTION = 1  # windows with a temporal prior
    REFINE_POSE = 2  # the motion pulled towards the silhouettes
    REFINE_SURFACE = 3  # the surface deformed to meet them

    @property
    def needs_images(self) -> bool:
        """Whether the stage looks at the images themselves."""
        return self >= Stage.REFINE_POSE
