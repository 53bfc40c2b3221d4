"""What the pixels of videos say: frames that show nothing, and joints of other frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.clip import FrameReader
from perfcap.io.doctor.finding import Finding, Severity, ranges

Array = NDArray[np.float32]

SHIFTS = 30  # frames looked at, both ways
_SIDE = 160  # px, of the longer side of images that are looked at
_PLAIN = 8.0  # grey levels between the darkest and the brightest hundredth
_STRETCH, _STEP, _ENOUGH = 160, 4, 30  # frames
_FEW = 5  # frames in which something must be seen
_VIEWS = 2  # most that are looked at for shifts
_CLEAR, _GAIN, _PEAK = 0.6, 0.08, 0.05  # shares of joints on what moves
_CONFIDENT = 0.3
_MUCH = 0.12  # of the joints, that another image of them has more on what moves
# of twenty recordings 57 % and more of a person who moves lie on what moves, 15 to 53 % of joints
# of another recording (one 63): a share below this is none of the former
_LITTLE = 0.5
# whoever moves by less than this of the body's size, or for less than these frames, has hidden part
# of what is behind for most of them: there 18 % were seen, 35 % where the joints move more
_MOVES = 0.1
_LONG, _LITTLE_SHORTLY = 90, 0.25
# joints (..., 2) in images with this last pixel, as another picture of the scene has them
_TURNS: dict[str, Callable[[NDArray[np.float64], NDArray[np.int64]], NDArray[np.float64]]] = {
    "mirrored": lambda at, corner: np.stack((corner[0] - at[..., 0], at[..., 1]), -1),
    "upside down": lambda at, corner: corner - at,
    "a quarter turned": lambda at, corner: np.stack((corner[0] - at[..., 1], at[..., 0]), -1),
    "three quarters turned": lambda at, corner: np.stack((at[..., 1], corner[1] - at[..., 0]), -1),
    "of a video half as large": lambda at, corner: 2 * at,
    "of a video twice as large": lambda at, corner: 0.5 * at,
}
_LIMBS = [
    *(("head_top", "neck"), ("neck", "r_hip"), ("neck", "l_hip")),
    *((f"{side}_shoulder", f"{side}_elbow") for side in "lr"),
    *((f"{side}_elbow", f"{side}_wrist") for side in "lr"),
    *((f"{side}_hip", f"{side}_knee") for side in "lr"),
    *((f"{side}_knee", f"{side}_ankle") for side in "lr"),
]
_BONES = np.array([[LANDMARKS.index(name) for name in limb] for limb in _LIMBS])


def examine_blank(clip: FrameReader, names: Sequence[str], start: int = 0) -> list[Finding]:
    """Views whose images are of one color, from a few frames evenly spread.

    Args:
        clip: C views.
        names: of the views, C.
        start: number of the first frame, as users count.
    """
    index = blank_frames(len(clip))
    findings = []
    for view, name in enumerate(names):
        plain = [frame for frame in index if _is_plain(_small(clip, view, frame))]
        if not plain:
            continue
        severity = Severity.ERROR if 2 * len(plain) > len(index) else Severity.WARNING
        where = ranges([start + frame for frame in plain])
        what = f"images are of one color, nothing can be seen in them (frames {where}"
        what += f" of {len(index)} looked at)"
        remedy = (
            "check the video; joints alone need no images: capture --until track_motion, actor fit "
            "--from joints"
        )
        findings.append(Finding(severity, name, what, remedy))
    return findings


def blank_frames(count: int) -> list[int]:
    """Frames of a clip of so many that ``examine_blank`` looks at."""
    index: list[int] = np.linspace(0, count - 1, min(count, _FEW)).round().astype(int).tolist()
    return index


def examine_footage(
    clip: FrameReader, sizes: Sequence[tuple[int, int]], detections: Detections, joints2d: Tensor
) -> list[Finding]:
    """Whether joints lie on what moves in their frame, in others, or in another picture of it.

    Cameras are at rest. What differs from the median image of a stretch of video moves; a person
    who stays in one place for all of it says nothing. Joints of other frames or another picture
    are wrong in every view: views can agree on them all the same.

    Args:
        clip: C views.
        sizes: (height, width) of each.
        detections: (F, C), of the clip's frames.
        joints2d: the same joints in pixels of the videos, (F, C, 16, 2).
    """
    count = min(len(clip), detections.frame_count)
    index, step = lively_frames(joints2d[:count], detections.confidence2d[:count])
    most = min(SHIFTS, count // 2)
    scores, turned = np.zeros(2 * most + 1), dict.fromkeys(_TURNS, 0.0)
    views, moves = range(min(len(sizes), _VIEWS)), True
    for view in views:
        height, width = sizes[view]
        moving = _moving(np.stack([_small(clip, view, frame) for frame in index]))
        places = joints2d[:count, view].numpy() * (_SIDE / max(height, width))
        seen = detections.confidence2d[:count, view].numpy() > _CONFIDENT
        for shift in range(-most, most + 1):
            scores[shift + most] += _hits(moving, places, seen, index, shift) / len(views)
        corner = np.array([moving.shape[2] - 1, moving.shape[1] - 1])
        for name, turn in _TURNS.items():
            hits = _hits(moving, turn(places, corner), seen, index, 0)
            turned[name] += hits / len(views)
        moves = moves and _deviation(places[index], seen[index]) > _MOVES
    found = _late(scores, most) or _turned(turned, scores[most])
    found = [replace(each, views=tuple(range(detections.views))) for each in found]
    little = _LITTLE if len(index) * step >= _LONG else _LITTLE_SHORTLY
    return found or (_foreign(scores[most]) if moves and scores[most] < little else [])


def lively_frames(joints2d: Tensor, confidence: Tensor) -> tuple[list[int], int]:
    """Frames that are looked at, of the stretch in which joints move farthest, and their distance.

    Args:
        joints2d: (F, C, 16, 2), pixels.
        confidence: (F, C, 16).
    """
    count, start = len(joints2d), _liveliest(joints2d, confidence)
    step = max(1, min(_STEP, count // _ENOUGH))
    return list(range(start, min(count, start + _STRETCH), step)), step


def _foreign(now: float) -> list[Finding]:
    """The finding that joints move and the images do not move with them."""
    what = f"the person's joints move, but only {now:.0%} of them lie on what moves in the video"
    remedy = (
        "are they of another video, or of somebody else in it? Does a camera move that is "
        "calibrated as if it did not?"
    )
    return [Finding(Severity.WARNING, "detections", what, remedy)]


def _deviation(places: NDArray[np.float64], seen: NDArray[np.bool_]) -> float:
    """Mean deviation of the joints (N, 16, 2) from their mean places, of the body's size.

    Of joints that most frames see; networks without a crown, say, never see all.
    """
    sizes = [
        np.ptp(at[now], axis=0).max() for at, now in zip(places, seen, strict=True) if any(now)
    ]
    often = np.flatnonzero(seen.sum(0) >= max(_FEW, 0.5 * len(seen)))
    if not len(often):
        return 0.0
    deviations = [places[seen[:, joint], joint].std(0).sum() for joint in often]
    return float(np.mean(deviations) / max(float(np.median(sizes)), 1e-6))


def _turned(scores: Mapping[str, float], now: float) -> list[Finding]:
    """A finding where the image of the joints clearly fits better than they do."""
    best = max(scores, key=scores.__getitem__)
    if scores[best] < _CLEAR or scores[best] - now < _MUCH:
        return []
    what = (
        f"joints look {best} against the video: {scores[best]:.0%} of them would lie on what moves "
        f"in it, {now:.0%} as they are"
    )
    remedy = "detect in this very video, in its pixels"
    return [Finding(Severity.ERROR, "detections", what, remedy)]


def _late(scores: NDArray[np.float64], most: int) -> list[Finding]:
    """A finding where another shift than none is a clear and narrow maximum."""
    best = int(scores.argmax())
    around = [scores[at] for at in (best - 8, best + 8) if 0 <= at < len(scores)]
    clear = scores[best] > _CLEAR and scores[best] - scores[most] > _GAIN
    if abs(best - most) < 3 or not clear or scores[best] - max(around, default=0.0) < _PEAK:
        return []
    shift = best - most
    way = "late" if shift > 0 else "early"
    what = (
        f"joints look {abs(shift)} or so frames {way}: so many frames away {scores[best]:.0%} of "
        f"them lie on what moves in the video, {scores[most]:.0%} as they are"
    )
    remedy = "detect in this very video, and count frames from its first"
    return [Finding(Severity.ERROR, "detections", what, remedy)]


def _liveliest(joints: Tensor, confidence: Tensor) -> int:
    """The first frame of the stretch in which joints move farthest."""
    count = len(joints) - _STRETCH
    if count <= 0:
        return 0
    both = (confidence[1:] > _CONFIDENT) & (confidence[:-1] > _CONFIDENT)
    steps = torch.where(both, joints.diff(dim=0).norm(dim=-1), 0).clamp(max=50).sum((1, 2))
    path = torch.cat((steps.new_zeros(1), steps.cumsum(0)))
    return int((path[_STRETCH:] - path[: len(path) - _STRETCH]).argmax())


def _small(clip: FrameReader, view: int, frame: int) -> Array:
    image = clip.read_view(view, frame, frame + 1)[0]
    height, width = image.shape[:2]
    scale = _SIDE / max(height, width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small: Array = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    return small


def _is_plain(image: Array) -> bool:
    low, high = np.percentile(image.mean(-1), (1, 99))
    return bool(high - low < _PLAIN)


def _moving(images: Array) -> Array:
    """How surely each pixel differs from the median image, 0 to 1, (N, h, w)."""
    difference = np.abs(images - np.median(images, 0)).sum(-1)
    usual = np.median(difference)
    share: Array = difference / (difference + 3 * usual + 10)
    return share


def _hits(
    moving: Array,
    places: NDArray[np.float64],
    seen: NDArray[np.bool_],
    index: list[int],
    shift: int,
) -> float:
    """Mean of ``moving`` under the limbs of joints ``shift`` frames later."""
    share = np.linspace(0, 1, 5)[:, None, None]
    values = []
    for image, frame in zip(moving, index, strict=True):
        if not 0 <= frame + shift < len(places):
            continue
        ends = places[frame + shift][_BONES[seen[frame + shift][_BONES].all(1)]]  # B 2 2
        points = ((1 - share) * ends[:, 0] + share * ends[:, 1]).reshape(-1, 2)
        x, y = np.rint(np.clip(points, -1, 1e6)).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < image.shape[1]) & (y < image.shape[0])
        if inside.sum() > 5:
            values.append(float(image[y[inside], x[inside]].mean()))
    return float(np.mean(values)) if 2 * len(values) >= len(index) and values else 0.0
