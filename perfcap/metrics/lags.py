"""Frames of a truth that are a little later or earlier: their rows, and what they are called."""

from __future__ import annotations


def overlap(count: int, lag: int) -> tuple[slice, slice]:
    """Rows of ``count`` that have others ``lag`` rows later, and those."""
    return slice(max(-lag, 0), count - max(lag, 0)), slice(max(lag, 0), count - max(-lag, 0))


def in_words(frames: int) -> str:
    """So many frames later, or earlier where it is negative."""
    count = abs(frames)
    return f"{count} frame{'s' if count > 1 else ''} {'later' if frames > 0 else 'earlier'}"
