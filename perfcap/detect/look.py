"""What a joint network sees in parts of an image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.candidates import Candidates
from perfcap.detect.crop import Crop, Frame, body_angle, body_box, body_crop
from perfcap.detect.decode import Estimate
from perfcap.detect.joint_set import LANDMARKS, JointSet
from perfcap.detect.manifest import Manifest

Box = tuple[float, float, float, float]

SEEN = 0.3  # confidence from which a joint tells where the person is
_FOUND = 0.3  # mean confidence of a body's landmarks from which somebody is there


class CropNetwork(Protocol):
    """What following needs of a detector."""

    manifest: Manifest

    @property
    def joint_set(self) -> JointSet:
        """Names of its joints."""

    def estimate(self, crops: NDArray[np.uint8]) -> Estimate:
        """Joints of crops (N, h, w, 3)."""


class Finder(Protocol):
    """What a search needs of a network that finds several people in an image."""

    @property
    def joint_set(self) -> JointSet:
        """Names of its joints."""

    def __call__(self, frame: Frame) -> list[Look]:
        """People of a frame (H, W, 3), the surest first; their crop is the whole image."""


@dataclass(frozen=True)
class Look:
    """What a network sees in one crop, in pixels and axes of the image.

    Attributes:
        crop: where it looked.
        joints2d: (J, 2).
        confidence: (J,).
        joints3d: (J, 3), metres; None without.
        candidates: where else joints may be, (1, J, C); None without heat maps.
    """

    crop: Crop
    joints2d: Tensor
    confidence: Tensor
    joints3d: Tensor | None
    candidates: Candidates | None

    def box(self) -> Box | None:
        """Around the body; None with too few joints."""
        return body_box(self.joints2d, self.confidence, SEEN)

    def around(self, network: CropNetwork, joint_set: JointSet, wider: float = 1.0) -> Crop | None:
        """A crop of this body for a network; None with too few joints.

        Args:
            network: that is to look.
            joint_set: of the joints of this look.
            wider: factor of the network's padding.
        """
        spec = network.manifest.input
        angle = turned(self, joint_set, spec.turns)
        return body_crop(
            self.joints2d, self.confidence, SEEN, spec.size, wider * spec.padding, angle
        )


def turned(look: Look, joint_set: JointSet, turns: str) -> float:
    """Angle of the next crop of a body, as the network's manifest wants crops.

    Quarter turns stay as they are: whoever bows is seen best as the crop was before. See
    ``search.turn_around``, which changes them.
    """
    if turns == "none":
        return 0.0
    if turns == "quarters":
        return look.crop.angle
    angle = body_angle(look.joints2d, look.confidence, joint_set)
    return look.crop.angle if angle is None else angle


def look_at(network: CropNetwork, frame: Frame, crops: Sequence[Crop]) -> list[Look]:
    """What a network sees in crops of a frame."""
    found = network.estimate(np.stack([crop.cut(frame) for crop in crops]))
    looks = []
    for row, crop in enumerate(crops):
        pose = None
        if found.joints3d is not None:
            pose = found.joints3d[row]
            if crop.angle:
                pose = pose @ crop.turn(pose).mT
        others = None
        if found.candidates is not None:
            places, support = found.candidates.places[[row]], found.candidates.support[[row]]
            others = Candidates(crop.to_image(places), support)
        points = crop.to_image(found.joints2d[row])
        looks.append(Look(crop, points, found.confidence[row], pose, others))
    return looks


def is_person(confidence: Tensor, joint_set: JointSet) -> bool:
    """Whether the landmarks that a set has are seen well enough, on average, to be somebody."""
    return bool(sureness(confidence, joint_set) >= _FOUND)


def sureness(confidence: Tensor, joint_set: JointSet) -> float:
    """Mean confidence of the landmarks that a set has; of the crown only where it is a joint.

    A crown that is made of ears is unsure whenever somebody turns, which does not make a person
    less of one.
    """
    columns, spans = _told_by(joint_set)
    least = torch.stack([part.amin() for part in torch.split(confidence[columns], spans)])
    return float(least.mean())


@lru_cache(maxsize=64)
def _told_by(joint_set: JointSet) -> tuple[list[int], list[int]]:
    """Joints that the landmarks of a set are made of, in a row, and how many of each."""
    names = [name for name in LANDMARKS if name != "head_top" or name in joint_set.joints]
    sources = [source for name in names if (source := joint_set.sources(name))]
    return [joint for source in sources for joint in source], [len(each) for each in sources]
