"""JSON of landmarks with names for their coordinates: MediaPipe, MoveNet of TensorFlow.js, ML Kit.

There is no one form: people write what their library hands them, frame by frame. A frame is a
person, a list of people, or an object that holds one of these under a usual key; a person is a
list of ``{x, y, ...}``, or an object of the lists of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from perfcap.detect.joint_set import KNOWN_JOINTS, LANDMARKS, JointSet, canonical_name
from perfcap.errors import InputError, one_line
from perfcap.io.detections.frame_numbers import by_number, frame_numbers
from perfcap.io.detections.listing import Listing, are_shares
from perfcap.io.detections.openpose import MAX_PEOPLE, choose_joint_set
from perfcap.io.detections.track import MAX_FRAMES, Array

_FRAMES = "frames"
_HOLDERS = ("pose_landmarks", "poseLandmarks", "landmarks", "landmark", "keypoints", "poses",
            "people")  # fmt: skip
_SURE = ("visibility", "score", "confidence", "presence", "conf", "likelihood", "probability",
         "prob", "visible", "c", "v")  # fmt: skip
_MEANT = ("visib", "score", "confiden", "likelihood", "probab")  # in other names of these
_NAMES = ("name", "part", "joint", "label", "keypoint")  # of a landmark
_TORSO = frozenset({"l_hip", "r_hip", "l_shoulder", "r_shoulder"})
_PLACE = re.compile(r"(?:\b|_)[xyzdXYZD](?:\b|_|\d)|^.?[xyz].?$|^[xyz][A-Z]|[a-z][XYZ]$|[dD]epth")
_DEEPEST = 6
_MOST_JOINTS = 1000
_LOOKED = 500  # landmarks


def holds_landmarks(data: Any) -> bool:
    """Whether the first thing that is in a value is a landmark with coordinates of its own."""
    return _is_landmark(_first(data, 0))


def _first(data: Any, depth: int) -> Any:
    """What is in the first list or object that is not empty; None where all are."""
    if depth > _DEEPEST or _is_landmark(data):
        return data
    if isinstance(data, dict):
        frames = _of_frames(data)
        return _first(_held(data) if frames is None else frames, depth + 1)
    if isinstance(data, list):
        found = (_first(each, depth + 1) for each in data)
        return next((each for each in found if each is not None), None)
    return data


def read_landmarks(path: Path, data: Any, video_frames: int | None = None) -> Listing:
    """Everybody in frames of landmarks; coordinates may be pixels, or shares of the image.

    Frames that say their number are those of the video, see ``by_number``. Landmarks that say their
    name are these joints, whatever their order.

    Args:
        path: for messages.
        data: a list of frames, or an object of it under ``frames`` or under their numbers.
        video_frames: of the video, where known.

    Raises:
        InputError: another structure, unknown joint counts.
    """
    frames = _of_frames(data) if isinstance(data, dict) else data
    if not isinstance(frames, list) or len(frames) > MAX_FRAMES:
        raise InputError(
            f"{path}: holds landmarks, but no list of frames; expected a list with an entry for "
            "each frame of the video"
        )
    names: list[str] = []
    people = [_people(path, number, frame, 0, names) for number, frame in enumerate(frames)]
    listed, warnings = by_number(path, frame_numbers(frames), people, video_frames)
    joint_set = _named(path, choose_joint_set(str(path), listed), names)
    if all((person[:, 2] == 1).all() for people in listed for person in people):
        warnings = (*warnings, *_unread(path, frames))
    return Listing(str(path), joint_set, listed, warnings, shares=are_shares(listed))


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


def _people(path: Path, frame: int, value: Any, depth: int, names: list[str]) -> list[Array]:
    """The people (J, 3) of a frame; nothing, empty lists and objects without people are nobody."""
    if not value:
        return []
    if _is_landmark(value):
        return [_person(path, frame, _apart(path, frame, value), names)]
    if isinstance(value, dict):
        held = _held(value) if depth < _DEEPEST else None
        return _people(path, frame, held, depth + 1, names)
    if not isinstance(value, list) or depth >= _DEEPEST:
        raise InputError(f"{path}: frame {frame} holds no landmarks; expected lists of x and y")
    if _is_landmark(value[0]):
        return [_person(path, frame, value, names)]
    people = [one for each in value for one in _people(path, frame, each, depth + 1, names)]
    if len(people) > MAX_PEOPLE:
        raise InputError(f"{path}: frame {frame} has more than {MAX_PEOPLE} people")
    return people


def _person(path: Path, frame: int, landmarks: list[Any], names: list[str]) -> Array:
    if len(landmarks) > _MOST_JOINTS or not all(_is_landmark(each) for each in landmarks):
        raise InputError(f"{path}: frame {frame} has landmarks without x and y; expected both")
    landmarks = _in_order(landmarks, names)
    rows = [(each["x"], each["y"], _sureness(each)) for each in landmarks]
    try:
        person = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path}: frame {frame} has landmarks that are no numbers") from error
    return person


def _apart(path: Path, frame: int, columns: Mapping[str, Any]) -> list[Any]:
    """Landmarks of a person whose x, y and ``visible`` are lists of them all, as Ultralytics'."""
    sure = next((columns[key] for key in _SURE if isinstance(columns.get(key), list)), None)
    lists = [columns["x"], columns["y"], columns.get("visible") if sure is None else sure]
    if lists[2] is None and isinstance(lists[0], list):
        lists[2] = [1.0] * len(lists[0])
    if not all(isinstance(each, list) for each in lists) or len({len(each) for each in lists}) > 1:
        raise InputError(f"{path}: frame {frame} has x, y and visible that are no equal lists")
    return [{"x": x, "y": y, "visibility": sure} for x, y, sure in zip(*lists, strict=True)]


def _sureness(landmark: Mapping[str, Any]) -> Any:
    known = next((landmark[key] for key in _SURE if landmark.get(key) is not None), None)
    if known is not None:
        return known
    meant = (key for key in landmark if any(word in key.lower() for word in _MEANT))
    return next((landmark[key] for key in meant if landmark[key] is not None), 1.0)


def _unread(path: Path, frames: list[Any]) -> Iterator[str]:
    """Numbers that may be confidences under names that are not known, where no others are."""
    values: dict[str, list[float]] = {}
    landmarks = list(islice(_every(frames, 0), _LOOKED))
    for landmark in landmarks:
        for key, value in landmark.items():
            if isinstance(value, float) and 0 <= value <= 1:
                values.setdefault(key, []).append(value)
    for key, held in values.items():
        changes = sum(one != other for one, other in pairwise(held))  # a time has one a person
        if not _PLACE.search(key) and len(held) == len(landmarks) and changes > len(held) / 3:
            yield (
                f"{path}: landmarks have no confidence, so that every joint counts as seen; if "
                f"{one_line(key)[:40]!r} is it, call it 'score'"
            )


def _every(data: Any, depth: int) -> Iterator[Mapping[str, Any]]:
    """All landmarks with coordinates of their own that are in a value."""
    if _is_landmark(data):
        yield data
    elif isinstance(data, list | dict) and depth <= _DEEPEST:
        for each in data.values() if isinstance(data, dict) else data:
            yield from _every(each, depth + 1)


def _in_order(landmarks: list[Any], names: list[str]) -> list[Any]:
    """Landmarks in the order of ``names``, which those of the first person who has some fill."""
    key = next((key for key in _NAMES if isinstance(landmarks[0].get(key), str)), None)
    called = [each.get(key) for each in landmarks] if key else []
    if not all(isinstance(name, str) for name in called):
        return landmarks
    if not names:
        names += called
    if called == names or len(called) != len(names):
        return landmarks
    own = dict(zip(called, landmarks, strict=True))
    if len(own) < len(called) or own.keys() != set(names):
        return landmarks
    return [own[name] for name in names]


def _named(path: Path, joint_set: JointSet, names: Sequence[str]) -> JointSet:
    """The joint set, or that of the names where they have a landmark in another place."""
    called = [canonical_name(name).replace("foot_index", "big_toe") for name in names]
    pairs = list(zip(called, joint_set.joints, strict=False))
    moved = any(name != joint and name in LANDMARKS for name, joint in pairs)
    if not moved or not set(called) >= _TORSO or len(called) != len(joint_set):
        return joint_set
    read = [name if name in KNOWN_JOINTS else f"unread_{i}" for i, name in enumerate(called)]
    try:
        return JointSet(f"{path.name}'s set", tuple(read))
    except ValueError as error:
        raise InputError(
            f"{path}: names of landmarks: {error}; expected each joint once"
        ) from error
