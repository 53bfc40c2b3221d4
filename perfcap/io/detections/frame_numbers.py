"""Which frame of the video an entry of a list is of, where it says so."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from perfcap.io.detections.openpose import first_frame
from perfcap.io.detections.track import MAX_FRAMES, Array

# as ``frame_numbers`` spells them
_KEYS = frozenset({"frame", "frameid", "frameidx", "frameindex", "frameno", "framenum",
                   "framenumber", "imageid"})  # fmt: skip


def frame_numbers(entries: Sequence[Any]) -> list[int]:
    """The number that each entry says its frame has; none where not all do, or all the same."""
    numbers = [_number(entry) for entry in entries]
    known = [number for number in numbers if number is not None]
    if len(known) < len(entries) or len(set(known)) < min(len(known), 2):
        return []
    span = max(known) - min(known)
    return known if min(known) >= 0 and span < min(MAX_FRAMES, 10 * len(known) + 100) else []


def _number(entry: Any) -> int | None:
    if not isinstance(entry, dict):
        return None
    stated = (value for key, value in entry.items() if _plain(key) in _KEYS)
    return next((v for v in stated if isinstance(v, int) and not isinstance(v, bool)), None)


def _plain(key: object) -> str:
    return str(key).lower().replace("_", "")


def by_number(
    path: Path, numbers: Sequence[int], people: Sequence[list[Array]], video_frames: int | None
) -> tuple[list[list[Array]], tuple[str, ...]]:
    """People of each frame of the video, and a note where frames at its beginning are missing.

    Args:
        path: for messages.
        numbers: of the frames, as ``frame_numbers`` has them; none for one entry a frame.
        people: of each entry.
        video_frames: of the video, where known: where entries leave out frames without people,
            those at the end are left out as well.
    """
    whole = len(people) == video_frames  # an entry a frame, whatever rate they were numbered at
    if not numbers or (whole and max(numbers) - min(numbers) >= len(people)):
        return list(people), ()
    first, last = first_frame(numbers, video_frames), max(numbers)
    listed: list[list[Array]] = [[] for _ in range(first, last + 1)]
    for number, found in zip(numbers, people, strict=True):
        listed[number - first] += found
    if len(set(numbers)) < len(listed):
        listed += [[]] * ((video_frames or 0) - len(listed))
    late = min(numbers) - first
    note = f"{path}: frame numbers start at {min(numbers)}; counted from {first}"
    return listed, (note,) if late else ()
