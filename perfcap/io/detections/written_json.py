"""JSON that programs write beside the usual lists: AlphaPose's other formats, easy_ViTPose."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from perfcap.detect.joint_set import KNOWN_JOINTS, JointSet, canonical_name
from perfcap.errors import InputError
from perfcap.io.detections.listing import Listing
from perfcap.io.detections.track import MAX_FRAMES, Array

# --- AlphaPose with --format open or cmu: people under the name of their image --------------------

_PEOPLE = {"people": "pose_keypoints_2d", "bodies": "joints"}


def results_by_image(data: Any) -> list[dict[str, Any]] | None:
    """AlphaPose's people of each image as a list of results; None of anything else."""
    if not isinstance(data, dict) or not data:
        return None
    if not all(isinstance(each, dict) and _PEOPLE.keys() & each.keys() for each in data.values()):
        return None
    found = []
    for image, held in data.items():
        key = next(key for key in _PEOPLE if key in held)
        people = held[key] if isinstance(held[key], list) else []
        numbers = [one.get(_PEOPLE[key]) for one in people if isinstance(one, dict)]
        found += [{"image_id": image, "keypoints": each} for each in numbers]
    return found


# --- COCO: annotations count images by ids of their own -------------------------------------------


def image_names(data: Any) -> Mapping[Any, str]:
    """File names of a COCO file's images by id, where the last numbers in them count frames."""
    images = data.get("images") if isinstance(data, dict) else None
    if not isinstance(images, list) or not all(isinstance(each, dict) for each in images):
        return {}
    names = {
        each["id"]: each["file_name"]
        for each in images
        if isinstance(each.get("id"), int) and isinstance(each.get("file_name"), str)
    }
    found = [re.findall(r"\d+", Path(name).stem, re.ASCII) for name in names.values()]
    if len(names) < len(images) or not all(found) or any(len(each[-1]) > 12 for each in found):
        return {}
    numbers = {int(each[-1]) for each in found}
    counts = len(numbers) == len(names) and np.ptp(list(numbers)) < 10 * len(names) + 100
    return names if counts else {}


# --- easy_ViTPose: rows before columns, people under their number, names of joints beside ---------


def holds_vitpose(data: Any) -> bool:
    """Whether a value is what easy_ViTPose writes."""
    return (
        isinstance(data, dict)
        and isinstance(data.get("skeleton"), dict)
        and isinstance(data.get("keypoints"), list)
    )


def read_vitpose(path: Path, data: Mapping[str, Any]) -> Listing:
    """Everybody in the frames of easy_ViTPose.

    Args:
        path: for messages.
        data: ``keypoints``, of each frame people by number, lists of (y, x, score), and
            ``skeleton``, names of the joints by number.

    Raises:
        InputError: another structure, or joints that are none of a person.
    """
    joint_set = _named(path, data["skeleton"])
    if len(data["keypoints"]) > MAX_FRAMES:
        raise InputError(f"{path}: has more than {MAX_FRAMES} frames")
    frames = []
    for number, people in enumerate(data["keypoints"]):
        if not isinstance(people, dict):
            raise InputError(f"{path}: frame {number} has no people by number")
        frames.append([_person(path, number, each, len(joint_set)) for each in people.values()])
    return Listing(str(path), joint_set, frames)


def _named(path: Path, skeleton: Mapping[str, Any]) -> JointSet:
    known = {key: name for key, name in skeleton.items() if key.isascii() and key.isdecimal()}
    names = [canonical_name(str(known[key])) for key in sorted(known, key=int)]
    if not {"l_hip", "r_hip", "l_shoulder", "r_shoulder"} <= set(names):
        raise InputError(
            f"{path}: its skeleton has no hips and shoulders ({', '.join(names[:4])[:60]}, ...); "
            "detect people, with a model of COCO"
        )
    unread = [name if name in KNOWN_JOINTS else f"unread_{i}" for i, name in enumerate(names)]
    try:
        return JointSet("easy_ViTPose's set", tuple(unread))
    except ValueError as error:
        raise InputError(f"{path}: skeleton: {error}; expected each joint once") from error


def _person(path: Path, frame: int, rows: Any, joints: int) -> Array:
    try:
        person = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path}: frame {frame} has keypoints that are no numbers") from error
    if person.shape != (joints, 3):
        raise InputError(
            f"{path}: frame {frame} has keypoints {person.shape}, expected ({joints}, 3): y, x, "
            "score of each joint of its skeleton"
        )
    return person[:, [1, 0, 2]]
