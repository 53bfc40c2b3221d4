"""One JSON file a view with all frames: AlphaPose, COCO results, MMPose predictions, landmarks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from perfcap.errors import InputError
from perfcap.io.detections.instance import parse_instance
from perfcap.io.detections.landmark_json import holds_landmarks, read_landmarks
from perfcap.io.detections.listing import Listing
from perfcap.io.detections.network import is_network_json, read_network_json
from perfcap.io.detections.openpose import choose_joint_set, first_frame, parse_triples
from perfcap.io.detections.track import MAX_FRAMES, Array, Track
from perfcap.io.files import read_json

Entries = Sequence[Mapping[str, Any]]


def read_keypoint_json(path: Path, frames: int | None = None) -> Track | Listing:
    """Read everybody of AlphaPose's or COCO's list of results, or of MMPose's predictions.

    Args:
        path: a list of ``{image_id, keypoints, score}``, or MMPose's list of
            ``{frame_id, instances}``, bare or under ``instance_info`` or ``predictions``, or
            frames of landmarks, see ``read_landmarks``, or lists of a network, see
            ``read_network``.
        frames: frames of the video; tells a numbering from 0 and one from 1 apart.

    Raises:
        InputError: another structure, unknown joint counts, nobody detected.
    """
    data = read_json(path, "keypoint JSON")
    if is_network_json(data):
        return read_network_json(path, data, frames)
    if holds_landmarks(data):
        return read_landmarks(path, data)
    entries = _entries(path, data)
    numbered = "instances" in entries[0]
    pairs = _mmpose(path, entries) if numbered else _results(path, entries)
    by_frame: dict[int, list[Array]] = {}
    for frame, people in pairs:
        by_frame.setdefault(frame, []).extend(people)
    first = (first_frame if numbered else _first_number)(by_frame, frames)
    last = max(by_frame)
    if last - first >= MAX_FRAMES or first < 0:
        raise InputError(
            f"{path}: frames are numbered {first} to {last}, expected them to count up"
        )
    listed = [by_frame.get(f, []) for f in range(first, last + 1)]
    if frames is not None and not numbered:  # results list nobody, so empty frames end unseen
        listed += [[]] * (frames - len(listed))
    joint_set = choose_joint_set(str(path), listed)
    warnings = []
    if frames is not None and first < min(by_frame) and (numbered or first == 0):
        warnings.append(f"{path}: frame numbers start at {min(by_frame)}; counted from {first}")
    return Listing(str(path), joint_set, listed, tuple(warnings))


def _entries(path: Path, data: Any) -> Entries:
    for key in ("instance_info", "predictions", "annotations"):
        if isinstance(data, dict) and key in data:
            data = data[key]
    if isinstance(data, list) and data and all(isinstance(e, list) for e in data):
        data = [{"frame_id": f, "instances": people} for f, people in enumerate(data)]
    if not isinstance(data, list) or not all(isinstance(entry, dict) for entry in data):
        raise InputError(
            f"{path}: is not a list of results; expected AlphaPose or COCO results, MMPose "
            "predictions, or a folder of OpenPose JSON"
        )
    if not data:
        raise InputError(f"{path}: is an empty list; expected a visible person")
    return data


def _results(path: Path, entries: Entries) -> Iterator[tuple[int, list[Array]]]:
    """AlphaPose and COCO: one entry a person, ``image_id`` a number or a file name."""
    for entry in entries:
        if "keypoints" not in entry or "image_id" not in entry:
            raise InputError(f"{path}: a result lacks image_id or keypoints; expected both")
        person = parse_triples(str(path), entry["keypoints"])
        yield _frame_number(path, entry["image_id"]), [] if person is None else [person]


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
