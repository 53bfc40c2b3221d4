"""Folders of text files that Ultralytics writes with ``save_txt``: a file a frame, a line a person.

A line is a class, the box, and x, y and confidence of each keypoint, shares of the image; the
confidence of the box and the number of a track may follow.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from perfcap.detect.joint_set import COCO17
from perfcap.errors import InputError
from perfcap.io.detections.listing import Listing
from perfcap.io.detections.openpose import FRAME_LIMIT, MAX_PEOPLE
from perfcap.io.detections.track import MAX_FRAMES, Array
from perfcap.io.files import require_file
from perfcap.io.view_names import rows_of

LABELS = "labels"  # folder of a run
_BOX = 5  # numbers before the keypoints: class, middle, width, height
_MORE = 2  # numbers that may follow: confidence of the box, track


def labels_in(folder: Path) -> Path | None:
    """The folder that has text files and no JSON: this one, or ``labels`` of a run; else None."""
    for place in (folder, folder / LABELS):
        inside = place.iterdir() if place.is_dir() else ()
        suffixes = {path.suffix.lower() for path in inside if path.name[0] != "."}
        if ".json" in suffixes:
            return None
        if ".txt" in suffixes:
            return place
    return None


def read_labels(
    folder: Path, video_frames: int | None = None, images: Sequence[str] = ()
) -> Listing:
    """Everybody in a view's folder; frames without people have no file.

    Args:
        folder: files end in the number of their frame; those of a video count from 1, those that
            are called as images are of these.
        video_frames: of the video, where known.
        images: names of the frames, of a folder of images.

    Raises:
        InputError: no frame numbers, other files, other numbers of keypoints.
    """
    by_frame: dict[int, list[Array]] = {}
    names: list[str] = []
    for path in sorted(folder.glob("*.[tT][xX][tT]")):
        if path.name == "classes.txt" or path.name.startswith("."):
            continue
        numbers = re.findall(r"\d+", path.stem, re.ASCII)
        if not numbers or len(numbers[-1]) > 12:
            raise InputError(f"{path}: has no frame number in its name; expected one file a frame")
        frame = int(numbers[-1])
        if frame in by_frame:
            raise InputError(f"{path}: is a second file of frame {frame}; keep one of them")
        by_frame[frame] = _people(path)
        names.append(path.stem)
    if not by_frame:
        raise InputError(f"{folder}: holds no text files of frames; expected Ultralytics' labels")
    rows = rows_of(names, images)
    if rows:
        by_frame = dict(zip(rows, by_frame.values(), strict=True))
    lowest, last = min(by_frame), max(by_frame)
    first = 0 if rows else min(lowest, 1)
    if video_frames is not None and last - first >= video_frames:  # images of a longer recording
        first = lowest
    if last - first >= min(MAX_FRAMES, 10 * len(by_frame) + 1000):
        raise InputError(
            f"{folder}: {len(by_frame)} files span the frames {lowest} to {last}; expected frame "
            "numbers that count up"
        )
    frames = [by_frame.get(f, []) for f in range(first, last + 1)]
    frames += [[]] * ((video_frames or 0) - len(frames))  # at the end, too
    return Listing(str(folder), COCO17, frames, shares=True)


def _people(path: Path) -> list[Array]:
    require_file(path, FRAME_LIMIT, "Ultralytics' labels")
    lines = path.read_text("utf-8", "replace").splitlines()
    if len(lines) > MAX_PEOPLE:
        raise InputError(f"{path}: has more than {MAX_PEOPLE} people")
    return [_person(path, line) for line in lines if line.strip()]


def _person(path: Path, line: str) -> Array:
    try:
        numbers = np.array(line.split(), np.float64)
    except ValueError:
        raise InputError(
            f"{path}: a line is no list of numbers; expected Ultralytics' labels"
        ) from None
    joints, given = len(COCO17), len(numbers) - _BOX
    for each in (3, 2):
        if 0 <= given - each * joints <= _MORE:
            person = numbers[_BOX : _BOX + each * joints].reshape(joints, each)
            if each == 3:
                return person
            seen = (person != 0).any(1, keepdims=True)
            return np.concatenate((person, seen.astype(np.float64)), 1)
    raise InputError(
        f"{path}: a line has {len(numbers)} numbers, expected a class, a box and {joints} "
        "keypoints of COCO with x, y and confidence, as a pose model writes them with "
        "save_txt=True"
    )
