"""JSON of landmarks with names for their coordinates: MediaPipe, MoveNet of TensorFlow.js.

There is no one form: people write what their library hands them, frame by frame. A frame is a
person, a list of people, or an object that holds one of these under a usual key; a person is a list
of ``{x, y, ...}``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from perfcap.errors import InputError
from perfcap.io.detections.listing import Listing, are_shares
from perfcap.io.detections.openpose import MAX_PEOPLE, choose_joint_set
from perfcap.io.detections.track import MAX_FRAMES, Array

_FRAMES = "frames"
_HOLDERS = ("pose_landmarks", "poseLandmarks", "landmarks", "landmark", "keypoints", "poses",
            "people")  # fmt: skip
_SURE = ("visibility", "score", "confidence", "presence")
_DEEPEST = 6
_MOST_JOINTS = 1000


def holds_landmarks(data: Any) -> bool:
    """Whether the first thing that is in a value is a landmark with coordinates of its own."""
    for _ in range(_DEEPEST):
        if isinstance(data, dict):
            if _is_landmark(data):
                return True
            data = _of_frames(data) if _of_frames(data) is not None else _held(data)
        elif isinstance(data, list):
            data = next((each for each in data if each), None)
        else:
            return False
    return isinstance(data, dict) and _is_landmark(data)


def read_landmarks(path: Path, data: Any) -> Listing:
    """Everybody in frames of landmarks; coordinates may be pixels, or shares of the image.

    Args:
        path: for messages.
        data: a list of frames, or an object of it under ``frames`` or under their numbers.

    Raises:
        InputError: another structure, unknown joint counts.
    """
    frames = _of_frames(data) if isinstance(data, dict) else data
    if not isinstance(frames, list) or len(frames) > MAX_FRAMES:
        raise InputError(
            f"{path}: holds landmarks, but no list of frames; expected a list with an entry for "
            "each frame of the video"
        )
    listed = [_people(path, number, frame, 0) for number, frame in enumerate(frames)]
    joint_set = choose_joint_set(str(path), listed)
    return Listing(str(path), joint_set, listed, shares=are_shares(listed))


def _of_frames(data: Mapping[str, Any]) -> list[Any] | None:
    if isinstance(data.get(_FRAMES), list):
        found: list[Any] = data[_FRAMES]
        return found
    numbered = {int(key): key for key in data if key.isascii() and key.isdecimal() and len(key) < 9}
    if not numbered or len(numbered) < len(data) or max(numbered) >= MAX_FRAMES:
        return None
    first = min(min(numbered), 1)
    return [data.get(numbered.get(n, "")) for n in range(first, max(numbered) + 1)]


def _held(data: Mapping[str, Any]) -> Any:
    return next((data[key] for key in _HOLDERS if data.get(key)), None)


def _is_landmark(value: Any) -> bool:
    return isinstance(value, dict) and "x" in value and "y" in value


def _people(path: Path, frame: int, value: Any, depth: int) -> list[Array]:
    """The people (J, 3) of a frame; nothing, empty lists and objects without people are nobody."""
    if not value:
        return []
    if isinstance(value, dict):
        return _people(path, frame, _held(value), depth + 1) if depth < _DEEPEST else []
    if not isinstance(value, list) or depth >= _DEEPEST:
        raise InputError(f"{path}: frame {frame} holds no landmarks; expected lists of x and y")
    if _is_landmark(value[0]):
        return [_person(path, frame, value)]
    people = [one for each in value for one in _people(path, frame, each, depth + 1)]
    if len(people) > MAX_PEOPLE:
        raise InputError(f"{path}: frame {frame} has more than {MAX_PEOPLE} people")
    return people


def _person(path: Path, frame: int, landmarks: list[Any]) -> Array:
    if len(landmarks) > _MOST_JOINTS or not all(_is_landmark(each) for each in landmarks):
        raise InputError(f"{path}: frame {frame} has landmarks without x and y; expected both")
    rows = [(each["x"], each["y"], _sureness(each)) for each in landmarks]
    try:
        person = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path}: frame {frame} has landmarks that are no numbers") from error
    return person


def _sureness(landmark: Mapping[str, Any]) -> Any:
    return next((landmark[key] for key in _SURE if landmark.get(key) is not None), 1.0)
