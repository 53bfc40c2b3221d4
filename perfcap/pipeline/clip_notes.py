"""What reading a clip had to say, which a capture in Python hands on as the command prints it."""

from __future__ import annotations

from perfcap.io.clip import RATE_SLACK, Clip, assumed_rate
from perfcap.pipeline.images import PartOfReader


def clip_notes(source: object, rate: float) -> tuple[str, ...]:
    """Warnings of a clip; none of what is no clip.

    Args:
        source: a ``Clip``, a part of one, or another reader or rate.
        rate: frames a second that the capture runs at; where it is not the clip's, what the clip
            assumes for images does not matter.
    """
    while isinstance(source, PartOfReader):
        source = source.reader
    if not isinstance(source, Clip):
        return ()
    another = abs(source.fps / rate - 1) > RATE_SLACK
    unused = assumed_rate(source.names[0]) if another else None
    return tuple(line for line in source.warnings if line != unused)
