"""One JSON file a view with all frames: AlphaPose, COCO results, MMPose predictions, landmarks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from perfcap.detect.joint_set import LANDMARKS, JointSet, canonical_name
from perfcap.errors import InputError
from perfcap.io.detections.frame_numbers import frame_numbers
from perfcap.io.detections.landmark_json import holds_landmarks, read_landmarks
from perfcap.io.detections.listing import Listing
from perfcap.io.detections.network import is_network_json, read_network_json
from perfcap.io.detections.openpose import choose_joint_set, first_frame, parse_triples
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
        return read_landmarks(path, data, frames)
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
    numbers = frame_numbers(entries) or range(len(entries))
    for position, (entry, place) in enumerate(zip(entries, numbers, strict=True)):
        instances = entry.get("instances")
        if not isinstance(instances, list):
            raise InputError(f"{path}: frame {position} has no list 'instances'")
        number = _frame_number(path, entry.get("frame_id", place))
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
