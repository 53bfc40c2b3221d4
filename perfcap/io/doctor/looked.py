"""Whether a network sees the person where the joints are, or where they are some frames later.

What moves in a video shows late joints of a person who goes somewhere, before cameras at rest. A
network that looks at the person shows them in place as well, and whatever the camera does: of the
joints of all frames, those of the image are the nearest to what it sees there.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.known_person import JUDGED, look_at_known
from perfcap.detect.look import CropNetwork
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.footage import Frames, lively_frames

_NETWORK = "lightning"  # the fastest of those shipped
_VIEWS, _LOOKS, _FEWEST = 2, 16, 6  # most that are looked at; looks that say something
_SHIFTS = 12  # frames, both ways
_CONFIDENT, _JOINTS = 0.3, 8
# Shares of the person, medians of joints: how near joints of another frame must be, and how much
# nearer than those of the same. No right stretch of 24 frames in one view comes near both at once:
# none of 101 is named, and of those 3 to 10 frames off two thirds (``late_joints.py``).
_SEEN, _NEARER, _LATE = 0.06, 0.8, 2


def examine_looks(
    clip: Frames, confidence: Tensor, joints2d: Tensor, network: CropNetwork | None = None
) -> list[Finding]:
    """Whether joints are late or early against the images in which a network sees the person.

    Args:
        clip: C views.
        confidence: of the joints, (F, C, 16).
        joints2d: in pixels of the videos, (F, C, 16, 2).
        network: that looks; the shipped one if not given.
    """
    count = min(len(clip), len(joints2d))
    if count < _FEWEST:
        return []
    index, _ = lively_frames(joints2d[:count], confidence[:count])
    frames = index[:: max(1, len(index) // _LOOKS)][:_LOOKS]
    places = joints2d[:count].detach().double().cpu().numpy().copy()
    places[confidence[:count].detach().cpu().numpy() <= _CONFIDENT] = np.nan
    network = network or _shipped()
    if network is None:
        return []
    off = [
        _apart(network, clip.read_view(view, frame, frame + 1)[0], places[:, view], frame)
        for view in range(min(places.shape[1], _VIEWS))
        for frame in frames
        if np.isfinite(places[frame, view]).all(-1).sum() >= _JOINTS
    ]
    return _late(np.stack(off)) if len(off) >= _FEWEST else []


@cache
def _shipped() -> CropNetwork | None:
    from perfcap.detect.onnx import OnnxDetector
    from perfcap.io.actor import models_folder

    folder = models_folder() / "detectors" / _NETWORK
    return OnnxDetector(folder) if folder.is_dir() else None


def _apart(
    network: CropNetwork, image: NDArray[np.uint8], places: NDArray[np.float64], frame: int
) -> NDArray[np.float64]:
    """Distances of what is seen in an image from joints (F, 16, 2) of frames around it.

    Returns:
        Shares of the person, (2 S + 1, J), of ``_SHIFTS`` S frames before to as many behind; NaN
        where unknown.
    """
    found = np.full((2 * _SHIFTS + 1, len(JUDGED)), np.nan)
    known = places[frame]
    looked = look_at_known(network, np.ascontiguousarray(image), known)
    if looked is None:
        return found
    size = float((np.nanmax(known, 0) - np.nanmin(known, 0)).max())
    first, last = max(0, frame - _SHIFTS), min(len(places), frame + _SHIFTS + 1)
    apart = np.linalg.norm(places[first:last] - looked[0], axis=-1)[:, JUDGED]
    found[first - frame + _SHIFTS : last - frame + _SHIFTS] = apart / max(size, 1e-6)
    return found


def _late(off: NDArray[np.float64]) -> list[Finding]:
    """A finding where joints of other frames are clearly nearer, by distances (N, 2 S + 1, J)."""
    known = np.isfinite(off).any(-1).sum(0) * 2 >= len(off)
    if not known[_SHIFTS]:
        return []
    misses = np.full(len(known), np.inf)
    misses[known] = np.nanmedian(off[:, known].transpose(1, 0, 2).reshape(known.sum(), -1), 1)
    best, now = int(misses.argmin()), float(misses[_SHIFTS])
    shift = best - _SHIFTS
    if abs(shift) < _LATE or misses[best] > min(_SEEN, _NEARER * now):
        return []
    way = "late" if shift > 0 else "early"
    what = (
        f"joints look {abs(shift)} or so frames {way} against the video: a network sees the person "
        f"{misses[best]:.1%} of their size from the joints of so many frames away, {now:.1%} from "
        "those of the same frame"
    )
    remedy = "detect in this very video, and count frames from its first"
    return [Finding(Severity.WARNING, "detections", what, remedy)]
