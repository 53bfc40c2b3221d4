"""One JSON file a view with all frames: AlphaPose, COCO results, MMPose predictions, landmarks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from perfcap.detect.joint_set import LANDMARKS, JointSet, canonical_name
from perfcap.errors import InputError
from perfcap.io.detections.listing import Listing, are_shares
from perfcap.io.detections.network import is_network_json, read_network_json
from perfcap.io.detections.openpose import MAX_PEOPLE, choose_joint_set, first_frame, parse_triples
from perfcap.io.detections.track import MAX_FRAMES, Array, Track, parse_instance
from perfcap.io.detections.written_json import (
    holds_vitpose,
    image_names,
    read_vitpose,
    results_by_image,
)
from perfcap.io.files import read_json
from perfcap.io.view_names import rows_of

Entries = Sequence[Mapping[str, Any]]


def read_keypoint_json(
    path: Path, frames: int | None = None, images: Sequence[str] = ()
) -> Track | Listing:
    """Read everybody of AlphaPose's or COCO's list of results, or of MMPose's predictions.

    Args:
        path: a list of ``{image_id, keypoints, score}``, or MMPose's list of
            ``{frame_id, instances}``, bare or under ``instance_info`` or ``predictions``, or
            frames of landmarks, see ``read_landmarks``, or lists of a network, see
            ``read_network``, or what AlphaPose and easy_ViTPose write else.
        frames: frames of the video; tells a numbering from 0 and one from 1 apart.
        images: names of the frames, of a folder of images: results that have such names are theirs.

    Raises:
        InputError: another structure, unknown joint counts, nobody detected.
    """
    data = read_json(path, "keypoint JSON")
    if is_network_json(data):
        return read_network_json(path, data, frames)
    if holds_landmarks(data):
        return read_landmarks(path, data)
    if holds_vitpose(data):
        return read_vitpose(path, data)
    entries = _entries(path, data)
    numbered = "instances" in entries[0]
    named = image_names(data)
    rows = [] if numbered else rows_of(_names(entries, named), images)
    pairs = _mmpose(path, entries) if numbered else _results(path, entries, named, rows)
    by_frame: dict[int, list[Array]] = {}
    for frame, people in pairs:
        by_frame.setdefault(frame, []).extend(people)
    first = 0 if rows else (first_frame if numbered else _first_number)(by_frame, frames)
    last = max(by_frame)
    if last - first >= MAX_FRAMES or first < 0:
        raise InputError(
            f"{path}: frames are numbered {first} to {last}, expected them to count up"
        )
    listed = [by_frame.get(f, []) for f in range(first, last + 1)]
    if frames is not None and not numbered:  # results list nobody, so empty frames end unseen
        listed += [[]] * (frames - len(listed))
    joint_set = choose_joint_set(str(path), listed)
    _require_names(path, data, joint_set)
    warnings = []
    counted = numbered or (first == 0 and not rows)
    if frames is not None and first < min(by_frame) and counted:
        warnings.append(f"{path}: frame numbers start at {min(by_frame)}; counted from {first}")
    return Listing(str(path), joint_set, listed, tuple(warnings))


def _require_names(path: Path, data: Any, joint_set: JointSet) -> None:
    """Refuse MMPose's predictions of another data set whose number of keypoints is the same.

    Raises:
        InputError: ``meta_info`` has one of our landmarks in another place than the joint set.
    """
    held = data.get("meta_info") if isinstance(data, dict) else None
    meta = held if isinstance(held, dict) else {}
    held = meta.get("keypoint_id2name")
    names = held if isinstance(held, dict) else {}
    for index, joint in enumerate(joint_set.joints):
        name = names.get(str(index))
        called = canonical_name(name) if isinstance(name, str) else joint
        if called != joint and called in LANDMARKS:
            raise InputError(
                f"{path}: keypoint {index} is {name!r:.40} (data set "
                f"{meta.get('dataset_name')!r:.40}), expected {joint} of {joint_set.name}; detect "
                "with a model of COCO, COCO-WholeBody or Halpe"
            )


def _entries(path: Path, data: Any) -> Entries:
    by_image = results_by_image(data)
    if by_image is not None:
        return by_image or _empty(path)
    for key in ("instance_info", "predictions", "annotations"):
        if isinstance(data, dict) and key in data:
            data = data[key]
    if isinstance(data, list) and data and all(isinstance(e, list) for e in data):
        data = [{"frame_id": f, "instances": people} for f, people in enumerate(data)]
    if isinstance(data, list) and data and all(isinstance(entry, str) for entry in data):
        raise InputError(
            f"{path}: its entries are text; where that is JSON, as of Ultralytics' to_json, write "
            "json.loads(...) of each"
        )
    if not isinstance(data, list) or not all(isinstance(entry, dict) for entry in data):
        raise InputError(
            f"{path}: is not a list of results; expected AlphaPose or COCO results, MMPose "
            "predictions, or a folder of OpenPose JSON"
        )
    return data or _empty(path)


def _empty(path: Path) -> Entries:
    raise InputError(f"{path}: is an empty list; expected a visible person")


def _results(
    path: Path, entries: Entries, names: Mapping[Any, str], rows: Sequence[int]
) -> Iterator[tuple[int, list[Array]]]:
    """AlphaPose and COCO: one entry a person, ``image_id`` a number or a file name, or the id of
    an image with a name. Their frames are ``rows``, where names of images tell them.
    """
    for place, entry in enumerate(entries):
        if "keypoints" not in entry or "image_id" not in entry:
            held = ", ".join(map(str, entry))[:60] or "nothing"
            raise InputError(
                f"{path}: a result lacks image_id or keypoints (it has {held}); expected both, as "
                "AlphaPose and COCO write them, or a list of frames"
            )
        image = _image(entry, names)
        person = parse_triples(str(path), entry["keypoints"])
        number = rows[place] if rows else _frame_number(path, image)
        yield number, [] if person is None else [person]


def _image(entry: Mapping[str, Any], names: Mapping[Any, str]) -> Any:
    """The image of a result: its name, or a number where none is known."""
    image = entry.get("image_id")
    return names.get(image, image) if isinstance(image, int) else image


def _names(entries: Entries, names: Mapping[Any, str]) -> list[str]:
    """Names of the images of results, without ending."""
    return [Path(str(_image(entry, names))).stem for entry in entries]


def _mmpose(path: Path, entries: Entries) -> Iterator[tuple[int, list[Array]]]:
    """MMPose: one entry a frame, keypoints and scores apart."""
    for position, entry in enumerate(entries):
        instances = entry.get("instances")
        if not isinstance(instances, list):
            raise InputError(f"{path}: frame {position} has no list 'instances'")
        number = _frame_number(path, entry.get("frame_id", position))
        yield number, [parse_instance(path, instance) for instance in instances]


def _frame_number(path: Path, image: Any) -> int:
    if isinstance(image, int) and not isinstance(image, bool):
        return image
    numbers = re.findall(r"\d+", Path(image).stem, re.ASCII) if isinstance(image, str) else []
    if not numbers or len(numbers[-1]) > 12:
        raise InputError(f"{path}: image_id {image!r} has no frame number; expected one")
    return int(numbers[-1])


def _first_number(by_frame: Mapping[int, Any], frames: int | None) -> int:
    """Results leave out frames without people, so the lowest number need not be the first frame.

    Numbering starts at 0, unless it reaches the number of frames or, that being unknown, never
    uses 0: then at 1.
    """
    lowest, highest = min(by_frame), max(by_frame)
    if frames is not None:
        return 0 if highest < frames else min(lowest, highest - frames + 1)
    return min(lowest, 1)


# --- JSON of landmarks with names for their coordinates: MediaPipe, MoveNet of TensorFlow.js ------
#
# There is no one form: people write what their library hands them, frame by frame. A frame is a
# person, a list of people, or an object that holds one of these under a usual key; a person is a
# list of ``{x, y, ...}``, or an object of the lists of them.

_FRAMES = "frames"
_HOLDERS = ("pose_landmarks", "poseLandmarks", "landmarks", "landmark", "keypoints", "poses",
            "people")  # fmt: skip
_SURE = ("visibility", "score", "confidence", "presence", "conf", "likelihood", "probability",
         "prob", "visible", "c", "v")  # fmt: skip
_DEEPEST = 6
_MOST_JOINTS = 1000


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
    if _is_landmark(value):
        return [_person(path, frame, _apart(path, frame, value))]
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
    return next((landmark[key] for key in _SURE if landmark.get(key) is not None), 1.0)
