"""A detector on frames of rendered sequences it has not learned from: joints, trust, time.

Joints are found in crops around the true person, and by following the person through the video
from a search of its first frame, as a capture does. A joint is found when it is nearer to the truth
than a fifth of the torso, left shoulder to right hip. Truth is used to score alone.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from numpy.typing import NDArray
from report import Report, Table, data_folder
from torch import Tensor

from perfcap.detect.crop import Crop, body_box
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.onnx import OnnxDetector
from perfcap.errors import InputError
from perfcap.io.actor import models_folder

_PCK = 0.2
_TORSO = LANDMARKS.index("l_shoulder"), LANDMARKS.index("r_hip")
_BANDS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.85, 1.01)
_TIMED = 30  # crops


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    detector: Path = models_folder() / "detectors" / "rendered"
    """Folder of the detector."""
    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Of the rendered set."""
    flip_test: bool | None = None
    """Look at mirror images too; as the manifest says if not given."""


@dataclass(frozen=True)
class Sequence:
    """Frames (F, H, W, 3), true joints (F, 16, 2) in pixels, and which are seen (F, 16)."""

    frames: NDArray[np.uint8]
    joints: Tensor
    visible: Tensor


@dataclass(frozen=True)
class Found:
    """Errors in torsos, those against the other side's joints, and confidences, (F, 16)."""

    errors: Tensor
    swapped: Tensor
    confidence: Tensor


def run(config: Experiment) -> Report:
    """Score crops and following, trust, and time."""
    detector = OnnxDetector(config.detector, flip_test=config.flip_test)
    folder = data_folder(config.data, "rendered")
    rows, joints = [], []
    everything: dict[str, list[Found]] = {"crops": [], "followed": []}
    for name in config.sequences:
        sequence = _read(folder / name)
        for way, find in (("crops", _in_crops), ("followed", _followed)):
            found = find(detector, sequence)
            rows.append((f"{name}, {way}", *_shares(found, sequence)))
            everything[way].append(found)
            if way == "crops":
                joints.append((name, *(100 * (found.errors <= _PCK).double().mean(0)).tolist()))
    return Report(
        (
            Table(
                "joints found (PCK@0.2 of the torso)",
                ("frames", "all %", "visible %", "hidden %", "either side %", "median error %"),
                tuple(rows),
            ),
            Table("by joint, in crops, %", ("frames", *LANDMARKS), tuple(joints), 0),
            *(_trust(way, found) for way, found in everything.items()),
            _time(detector),
        ),
        ("Either side: nearer than a fifth of a torso to the joint or to its counterpart.",),
    )


def _read(folder: Path) -> Sequence:
    frames = []
    video = cv2.VideoCapture(str(folder / "video.mp4"))
    while True:
        good, frame = video.read()
        if not good:
            break
        frames.append(frame[..., ::-1])
    if not frames:
        raise InputError(f"{folder / 'video.mp4'}: has no frames; expected a rendered sequence")
    with np.load(folder / "gt.npz") as truth:
        joints = torch.tensor(truth["joints2d"] - 0.5).float()  # its image corner is at 0
        visible = torch.tensor(truth["joint_visible"].astype(bool))
    return Sequence(np.stack(frames), joints, visible)


def _in_crops(detector: OnnxDetector, sequence: Sequence) -> Found:
    points, confidence = [], []
    for frame, joints in zip(sequence.frames, sequence.joints, strict=True):
        box = body_box(joints, torch.ones(len(joints)), 0.5)
        assert box is not None
        crop = Crop.around(box, detector.crop_size, detector.manifest.input.padding)
        estimate = detector.estimate(crop.cut(frame)[None])
        points.append(crop.to_image(estimate.joints2d[0]))
        confidence.append(estimate.confidence[0])
    return _errors(torch.stack(points), torch.stack(confidence), sequence)


def _followed(detector: OnnxDetector, sequence: Sequence) -> Found:
    detections = detector.follow(iter(sequence.frames))
    return _errors(detections.joints2d[:, 0], detections.confidence2d[:, 0], sequence)


def _errors(points: Tensor, confidence: Tensor, sequence: Sequence) -> Found:
    other = sequence.joints[:, list(LANDMARKS16.mirrored())]
    errors, swapped = (_distance(points, truth, sequence) for truth in (sequence.joints, other))
    return Found(errors, swapped, confidence)


def _distance(points: Tensor, truth: Tensor, sequence: Sequence) -> Tensor:
    """In torsos, (F, 16)."""
    shoulder, hip = (sequence.joints[:, joint] for joint in _TORSO)
    torso = (shoulder - hip).norm(dim=-1, keepdim=True)
    share: Tensor = (points - truth).norm(dim=-1) / torso
    return share


def _shares(found: Found, sequence: Sequence) -> tuple[float, ...]:
    hit = (found.errors <= _PCK).double()
    either = (torch.minimum(found.errors, found.swapped) <= _PCK).double()
    seen = sequence.visible
    parts = (hit.mean(), hit[seen].mean(), hit[~seen].mean(), either.mean())
    return (*(100 * float(part) for part in parts), 100 * float(found.errors.median()))


def _trust(way: str, everything: list[Found]) -> Table:
    """How many joints of a confidence are found, and how far off they are."""
    errors = torch.cat([found.errors.flatten() for found in everything])
    confidence = torch.cat([found.confidence.flatten() for found in everything])
    rows = []
    for low, high in pairwise(_BANDS):
        here = (confidence >= low) & (confidence < high)
        if here.any():
            hit = 100 * float((errors[here] <= _PCK).double().mean())
            mean, median = float(confidence[here].mean()), float(errors[here].median())
            band = f"{low:g} to {min(high, 1):g}"
            rows.append((band, int(here.sum()), 100 * mean, hit, 100 * median))
    columns = ("confidence", "joints", "promised %", "found %", "median error, % of torso")
    return Table(f"confidence against error, {way}", columns, tuple(rows))


def _time(detector: OnnxDetector) -> Table:
    """CPU and wall time of one crop on one thread."""
    rng = np.random.default_rng(0)
    crops = rng.integers(0, 255, (1, *detector.crop_size, 3), dtype=np.uint8)
    detector.estimate(crops)
    wall, busy = [], []
    for _ in range(_TIMED):
        start, cpu = time.perf_counter(), time.process_time()
        detector.estimate(crops)
        wall.append(time.perf_counter() - start)
        busy.append(time.process_time() - cpu)
    height, width = detector.crop_size
    row = (f"{width}x{height}", 1e3 * float(np.median(wall)), 1e3 * float(np.median(busy)))
    return Table("a crop, one thread, ms", ("size", "wall", "CPU"), (row,))


if __name__ == "__main__":
    report.main(run, Experiment, "detector_frames")
