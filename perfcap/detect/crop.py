"""The part of an image a network sees, and the way back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS, JointSet, map_to_landmarks
from perfcap.errors import InputError
from perfcap.setting_checks import require_number, require_size

Frame = NDArray[np.uint8]

_BORDER = 0  # what networks saw outside images when they were trained: black


@dataclass(frozen=True)
class Crop:
    """A rectangle of an image, drawn at a network's input size.

    Attributes:
        center: (x, y) of its middle, image pixels.
        width: image pixels; the height follows from the input's shape.
        size: (height, width) of the input, pixels.
        angle: from the image's x axis to the crop's, towards y, radians; 0 is upright.
    """

    center: tuple[float, float]
    width: float
    size: tuple[int, int]
    angle: float = 0.0

    def __post_init__(self) -> None:
        require_size(self.width, "width of a crop", finite=True)
        require_number(self.angle, "angle of a crop")
        if abs(self.angle) > math.tau:
            raise InputError(
                f"angle of a crop is {self.angle:.4g}, expected radians, a turn at most: "
                "math.radians converts degrees"
            )

    @classmethod
    def around(
        cls, box: tuple[float, float, float, float], size: tuple[int, int], padding: float = 1.0
    ) -> Self:
        """The smallest crop of the input's shape around a box (left, top, right, bottom).

        Args:
            box: edges, image pixels.
            size: of the input.
            padding: factor of the box.
        """
        left, top, right, bottom = box
        height, width = size
        wide = max(right - left, (bottom - top) * width / height, 1e-3)
        return cls((0.5 * (left + right), 0.5 * (top + bottom)), padding * wide, size)

    @property
    def scale(self) -> float:
        """Image pixels a crop pixel."""
        return self.width / self.size[1]

    @property
    def height(self) -> float:
        """Image pixels."""
        return self.scale * self.size[0]

    def cut(self, frame: Frame) -> Frame:
        """The crop of a frame (H, W, 3), (h, w, 3); black outside the image."""
        height, width = self.size
        matrix = self.matrix(torch.zeros((), dtype=torch.float64)).numpy()
        part: Frame = cv2.warpAffine(
            frame,
            matrix,  # crop to image: that is the direction the map is evaluated in
            (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(_BORDER,) * 3,
        )
        return part

    def to_image(self, points: Tensor) -> Tensor:
        """Image pixels of crop pixels (..., 2)."""
        matrix = self.matrix(points)
        return points @ matrix[:, :2].mT + matrix[:, 2]

    def from_image(self, points: Tensor) -> Tensor:
        """Crop pixels of image pixels (..., 2)."""
        matrix = self.matrix(points)
        return (points - matrix[:, 2]) @ matrix[:, :2] / self.scale**2

    def matrix(self, like: Tensor) -> Tensor:
        """``to_image`` as an affine map, (2, 3)."""
        across, down = self.scale * math.cos(self.angle), self.scale * math.sin(self.angle)
        # pixel centres are at integers in both
        x, y = 0.5 * (self.size[1] - 1), 0.5 * (self.size[0] - 1)
        left = self.center[0] - across * x + down * y
        top = self.center[1] - down * x - across * y
        return like.new_tensor([[across, -down, left], [down, across, top]])

    def turn(self, like: Tensor) -> Tensor:
        """Takes 3D vectors from the crop's axes to the image's, x right, y down; (3, 3)."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return like.new_tensor([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


# How far a body reaches beyond its joints: crown above the eyes, toes below the ankles.
_BEYOND = 0.08  # of the larger extent of the joints
_KEPT_SIZE = 0.9  # of the width of the last crop: limbs that are lost for a frame come back
_WIDER, _MANY = 0.15, 4  # how much wider the crop is where so many joints are missing, or more
_MIN_JOINTS = 4
_SHOULDERS = [LANDMARKS.index("l_shoulder"), LANDMARKS.index("r_shoulder")]
_HIPS = [LANDMARKS.index("l_hip"), LANDMARKS.index("r_hip")]


def body_box(
    joints2d: Tensor, confidence: Tensor, threshold: float
) -> tuple[float, float, float, float] | None:
    """Box of the confident joints, grown to hold a body; None with too few of them.

    Args:
        joints2d: (J, 2), pixels.
        confidence: (J,).
        threshold: below which a joint does not count.
    """
    points = joints2d[confidence >= threshold]
    if len(points) < _MIN_JOINTS:
        return None
    low, high = points.amin(0), points.amax(0)
    grow = _BEYOND * float((high - low).max())
    left, top, right, bottom = (float(v) for v in torch.cat((low - grow, high + grow)))
    return left, top, right, bottom


def body_crop(
    joints2d: Tensor,
    confidence: Tensor,
    threshold: float,
    size: tuple[int, int],
    padding: float,
    angle: float = 0.0,
) -> Crop | None:
    """The smallest crop around a body, in axes turned by an angle; None with too few joints.

    Args:
        joints2d: (J, 2), image pixels.
        confidence: (J,).
        threshold: below which a joint does not count.
        size: (height, width) of the network's input.
        padding: size of the crop, in sizes of the body.
        angle: of the crop, radians.
    """
    turn = Crop((0.0, 0.0), 1.0, (1, 1), angle).matrix(joints2d)[:, :2]
    box = body_box(joints2d @ turn, confidence, threshold)
    if box is None:
        return None
    crop = Crop.around(box, size, padding)
    x, y = (turn @ turn.new_tensor(crop.center)).tolist()
    return Crop((x, y), crop.width, size, angle)


def next_crop(
    crop: Crop,
    joints2d: Tensor,
    confidence: Tensor,
    threshold: float,
    padding: float,
    angle: float = 0.0,
) -> Crop | None:
    """Where to look in the next frame, from the joints of this one; None when the person is lost.

    It shrinks slowly and grows at once, and is wider the more joints are missing, so that limbs
    that are lost for a moment stay inside or come back.

    Args:
        crop: of this frame.
        joints2d: (J, 2), image pixels.
        confidence: (J,).
        threshold: below which a joint does not count.
        padding: size of the crop, in sizes of the body.
        angle: of the next crop, radians.
    """
    missing = min(1.0, float((confidence < threshold).sum()) / _MANY)
    wider = (1 + _WIDER * missing) * padding
    found = body_crop(joints2d, confidence, threshold, crop.size, wider, angle)
    if found is None:
        return None
    return replace(found, width=max(found.width, _KEPT_SIZE * crop.width))


def body_angle(joints2d: Tensor, confidence: Tensor, joint_set: JointSet) -> float | None:
    """How far a body leans, from hips to shoulders, radians: the angle of a crop that shows it
    upright. None where shoulders or hips are not seen.

    Args:
        joints2d: (J, 2), image pixels.
        confidence: (J,).
        joint_set: names of the J joints.
    """
    points, trust = map_to_landmarks(joints2d, confidence, joint_set)
    if bool((trust[[*_SHOULDERS, *_HIPS]] <= 0).any()):
        return None
    right, down = (points[_SHOULDERS].mean(0) - points[_HIPS].mean(0)).tolist()
    return math.atan2(right, -down) if right or down else None
