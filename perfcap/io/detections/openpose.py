"""Folders of JSON of OpenPose, MMPose and Sapiens, one file a frame."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.detect.joint_set import (
    BLAZEPOSE33,
    BODY_25,
    BODY_25B,
    COCO17,
    COCO18,
    COCO_WHOLEBODY,
    H36M17,
    HALPE26,
    HALPE136,
    JointSet,
)
from perfcap.errors import InputError
from perfcap.io.detections.listing import Listing
from perfcap.io.detections.track import MAX_FRAMES, Array, parse_instance
from perfcap.io.doctor.finding import counted
from perfcap.io.files import MEBIBYTE, read_json
from perfcap.io.view_names import rows_of

FRAME_LIMIT = 16 * MEBIBYTE
MAX_PEOPLE = 1000
KEYPOINTS = "pose_keypoints_2d"
_SETS = (COCO17, COCO18, BODY_25, HALPE26, BLAZEPOSE33, COCO_WHOLEBODY, HALPE136)
BY_COUNT = {len(s): s for s in _SETS}
# joints that lie about half-way between two others: hips, chest and spine
_H36M = ((0, 1, 4), (8, 11, 14), (7, 0, 8))
_KINECT = ((0, 12, 16), (20, 4, 8), (1, 0, 20))
_SEEN = 0.05  # confidence
_HALFWAY, _THIGH = 0.1, 0.12  # of the person's size: how far off, and to joint 2 from the hips


def read_openpose(
    folder: Path, video_frames: int | None = None, images: Sequence[str] = ()
) -> Listing:
    """Read everybody of one view's folder; the number of keypoints tells the joint set.

    Files that are called as images are of these; else the last number in a file's name is its frame
    (see ``first_frame``). Frames without a file, like files without people, have nothing detected.

    Args:
        folder: one file a frame.
        video_frames: of the video, where known.
        images: names of the frames, of a folder of images.

    Raises:
        InputError: no JSON files, two files of one frame, broken JSON, unknown keypoint counts.
    """
    files = _by_frame(folder)
    rows = rows_of([_stem(path) for path in files.values()], images)
    if rows:
        files = dict(zip(rows, files.values(), strict=True))
    first, last = 0 if rows else first_frame(files, video_frames), max(files)
    frames = [_people(files[f]) if f in files else [] for f in range(first, last + 1)]
    warnings = []
    missing = last - first + 1 - len(files)
    if missing:
        warnings.append(f"{folder}: no file of {counted(missing)} between {first} and {last}")
    if first < min(files):
        warnings.append(f"{folder}: files start at frame {min(files)}; counted from {first}")
    joint_set = choose_joint_set(str(folder), frames)
    return Listing(str(folder), joint_set, frames, tuple(warnings))


def first_frame(numbers: Collection[int], video_frames: int | None) -> int:
    """The number of the video's first frame, where detectors tell of every frame.

    That is the lowest, whatever it is, as of images cut from a longer recording; but if it is above
    1, and all numbers are those of frames of the video counted from 0 or from 1, then what was
    detected in its first frames is missing.
    """
    lowest, highest = min(numbers), max(numbers)
    if video_frames is None or lowest <= 1:
        return lowest
    return next((start for start in (0, 1) if highest < start + video_frames), lowest)


def _stem(path: Path) -> str:
    return path.stem.removesuffix("_keypoints")


def _by_frame(folder: Path) -> dict[int, Path]:
    files: dict[int, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() != ".json" or path.name.startswith("."):
            continue
        numbers = re.findall(r"\d+", _stem(path), re.ASCII)
        if not numbers or len(numbers[-1]) > 12:
            raise InputError(f"{path}: has no frame number in its name; expected one file a frame")
        frame = int(numbers[-1])
        if frame in files:
            raise InputError(
                f"{path}: is frame {frame} as is {files[frame].name}; keep one of them"
            )
        files[frame] = path
    if not files:
        raise InputError(f"{folder}: holds no JSON files; expected OpenPose output, one a frame")
    span = max(files) - min(files) + 1
    if span > min(MAX_FRAMES, 10 * len(files) + 100):
        raise InputError(
            f"{folder}: {len(files)} files span the frames {min(files)} to {max(files)}; expected "
            "frame numbers that count up; remove files of other recordings"
        )
    return files


def _people(path: Path) -> list[Array]:
    """The people (J, 3) of one file of OpenPose, or of MMPose's and Sapiens' ``instance_info``, or
    of the bare list that MMPose writes of an image; ``{}`` and an empty list are nobody.
    """
    data = read_json(path, "OpenPose JSON", FRAME_LIMIT)
    instances = data.get("instance_info") if isinstance(data, dict) else data
    if isinstance(instances, list) and len(instances) <= MAX_PEOPLE and _are_instances(instances):
        return [parse_instance(path, each) for each in instances]
    people = data.get("people", None if data else []) if isinstance(data, dict) else None
    if not isinstance(people, list) or len(people) > MAX_PEOPLE:
        raise InputError(
            f"{path}: has no list 'people'; expected OpenPose JSON, or MMPose's or Sapiens' "
            "keypoints and keypoint_scores; of other programs, one file with a list of all frames"
        )
    return [keypoints for person in people if (keypoints := _keypoints(path, person)) is not None]


def _are_instances(people: list[Any]) -> bool:
    return all(
        isinstance(each, dict) and isinstance(each.get("keypoints"), list) for each in people
    )


def _keypoints(path: Path, person: Any) -> Array | None:
    numbers = person.get(KEYPOINTS, []) if isinstance(person, dict) else None
    if not isinstance(numbers, list):
        raise InputError(f"{path}: a person has no list '{KEYPOINTS}'; expected OpenPose JSON")
    return parse_triples(str(path), numbers)


def parse_triples(where: str, numbers: Any) -> Array | None:
    """x, y, confidence of each joint, (J, 3), of a flat list; None of an empty one."""
    try:
        flat = np.asarray(numbers, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{where}: keypoints are not numbers; expected x, y, confidence"
        ) from error
    if not flat.size:
        return None
    if flat.size % 3:
        raise InputError(
            f"{where}: a person has {flat.size} numbers, expected x, y, confidence for each joint"
        )
    return flat.reshape(-1, 3)


def choose_joint_set(where: str, frames: Sequence[Sequence[Array]]) -> JointSet:
    """The joint set of the people found, by their number of joints.

    BODY_25 and BODY_25B both have 25: in the first, joint 8 is the middle of 9 and 12 (the hips),
    in the second, joint 17 that of 5 and 6 (the shoulders). COCO and Human3.6M both have 17: in the
    second, joints 0, 7 and 8 go up the spine. Where nobody is, any set will do.

    Raises:
        InputError: people of different or unknown numbers of joints, or in Kinect's order.
    """
    people = [person for candidates in frames for person in candidates]
    if not people:
        return COCO17
    counts = sorted({len(person) for person in people})
    if len(counts) > 1:
        raise InputError(
            f"{where}: people have {counts[0]} and {counts[-1]} joints; expected one set"
        )
    joint_set = BY_COUNT.get(counts[0])
    if joint_set is None:
        known = ", ".join(f"{n} ({s.name})" for n, s in sorted(BY_COUNT.items()))
        raise InputError(f"{where}: people have {counts[0]} joints, expected {known}")
    if joint_set is COCO17 and _go_up(people, _H36M) and _apart(people, 0, 2) > _THIGH:
        return H36M17
    if joint_set is BODY_25 and _go_up(people, _KINECT):
        raise InputError(
            f"{where}: joints 0, 1 and 20 go up the spine, as of Kinect's 25; expected the order "
            "of BODY_25: write detections.npz with joint_names"
        )
    if joint_set is BODY_25 and _off_middle(people, 17, 5, 6) < _off_middle(people, 8, 9, 12):
        return BODY_25B
    return joint_set


def _off_middle(people: Sequence[Array], joint: int, left: int, right: int) -> float:
    """Median distance of a joint from the middle of two others; infinite when never seen."""
    stacked = np.stack(people)
    seen = stacked[_known(stacked)[:, (joint, left, right)].all(-1)]
    if not len(seen):
        return float("inf")
    middle = (seen[:, left, :2] + seen[:, right, :2]) / 2
    return float(np.nanmedian(np.linalg.norm(seen[:, joint, :2] - middle, axis=-1)))


def _go_up(people: Sequence[Array], spine: Sequence[tuple[int, int, int]]) -> bool:
    """Whether joints lie half-way between two others, as those of a spine do."""
    size = _size(people)
    return size > 0 and all(_off_middle(people, *each) < _HALFWAY * size for each in spine)


def _apart(people: Sequence[Array], one: int, other: int) -> float:
    """Median distance of two joints by the person's size; infinite where they are never seen."""
    return _off_middle(people, one, other, other) / _size(people)


def _size(people: Sequence[Array]) -> float:
    """Median diagonal of the boxes about the joints that are seen."""
    stacked = np.stack(people)
    known = _known(stacked)[..., None]
    high = np.where(known, stacked, -np.inf).max(1)
    low = np.where(known, stacked, np.inf).min(1)
    there = known.any((1, 2))
    if not there.any():
        return 0.0
    return float(np.median(np.linalg.norm((high - low)[there, :2], axis=-1)))


def _known(people: Array) -> NDArray[np.bool_]:
    """Joints (N, J, 3) that are seen somewhere, (N, J)."""
    return np.isfinite(people).all(-1) & (people[..., 2] > _SEEN)
