"""One person through the frames of a view: found once, then followed from crop to crop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.candidates import Candidates, join_candidates
from perfcap.detect.crop import Crop, Frame, body_box, next_crop
from perfcap.detect.decode import Estimate
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, JointSet, map_to_landmarks
from perfcap.detect.manifest import Manifest
from perfcap.detect.sides import Track, settle_sides
from perfcap.detect.viewing_ray import toward
from perfcap.geometry.camera import Camera

Box = tuple[float, float, float, float]

SEEN = 0.3  # confidence from which a joint tells where the person is
_FOUND = 0.3  # mean confidence of a body's landmarks from which somebody is there
_SCALES = (1.0, 0.6, 0.36)  # of the image: sizes of the windows searched
_STEP = 0.5  # of a window: how far apart they are
_CANDIDATES = 3  # windows looked at again around what they show
_AGAIN = (1.5, 1.0)  # crops centred on what is seen, the first wider: limbs may be cut off


class CropNetwork(Protocol):
    """What following needs of a detector."""

    manifest: Manifest

    @property
    def joint_set(self) -> JointSet:
        """Names of its joints."""

    def estimate(self, crops: NDArray[np.uint8]) -> Estimate:
        """Joints of crops (N, h, w, 3)."""


@dataclass(frozen=True)
class _Look:
    """What a network sees in one crop, in pixels of the image."""

    crop: Crop
    joints2d: Tensor  # (J, 2)
    confidence: Tensor  # (J,)
    joints3d: Tensor | None  # (J, 3)
    candidates: Candidates | None  # (1, J, C)

    def box(self) -> Box | None:
        return body_box(self.joints2d, self.confidence, SEEN)


def follow_person(
    network: CropNetwork, frames: Iterable[Frame], box: Box | None, camera: Camera | None = None
) -> Detections:
    """Joints of one person in every frame of a view, (F, 1).

    The crop of a frame is centred on the joints of the frame before. Where nobody is followed,
    windows of several sizes are searched all over the image. Left and right are settled at the
    end, by motion; see ``settle_sides``.

    Args:
        network: the detector.
        frames: (H, W, 3), RGB, in order.
        box: (left, top, right, bottom) of the person in the first frame; None to search.
        camera: the view, in pixels of the frames; turns 3D joints from the axes of each crop
            into the camera's where the manifest says they are (Mehta et al. 2017).

    Returns:
        The 16 landmarks in pixels of the frames, float32; confidence 0 where nobody is found.
    """
    looks = _settled(list(_follow(network, frames, box)), network.joint_set)
    if camera is not None and network.manifest.output.crop_axes:
        looks = _in_camera_axes(looks, camera)
    return _to_detections(looks, network.joint_set)


def _follow(
    network: CropNetwork, frames: Iterable[Frame], box: Box | None
) -> Iterator[_Look | None]:
    spec = network.manifest.input
    crop = None if box is None else Crop.around(box, spec.size, spec.padding)
    whole_only = network.manifest.output.kind == "joints3d"
    for number, frame in enumerate(frames):
        if whole_only:  # no 2D joints to follow
            part = Crop.around(box or _whole(frame), spec.size, spec.padding if box else 1.0)
            yield _look(network, frame, [part])[0]
            continue
        look = None
        if crop is not None:
            look = _look(network, frame, [crop])[0]
            if number == 0:
                look = _centre(network, frame, look)
        if look is None or not is_person(look.confidence, network.joint_set):
            look = _search(network, frame)
        yield look
        crop = (
            None
            if look is None
            else next_crop(look.crop, look.joints2d, look.confidence, SEEN, spec.padding)
        )


def is_person(confidence: Tensor, joint_set: JointSet) -> bool:
    """Whether the landmarks that a set has are seen well enough, on average, to be somebody."""
    return bool(_sureness(confidence, joint_set) >= _FOUND)


def _sureness(confidence: Tensor, joint_set: JointSet) -> float:
    sources = [joint_set.sources(name) for name in LANDMARKS]
    known = [confidence[list(source)].amin() for source in sources if source]
    return float(torch.stack(known).mean())


def _search(network: CropNetwork, frame: Frame) -> _Look | None:
    """The surest person of windows all over the image, looked at once more up close."""
    spec = network.manifest.input
    windows = list(_windows(frame, spec.size))
    looks = _look(network, frame, windows)
    looks.sort(key=lambda look: -_sureness(look.confidence, network.joint_set))
    closer = [_centre(network, frame, look) for look in looks[:_CANDIDATES]]
    best = max(closer, key=lambda look: _sureness(look.confidence, network.joint_set))
    return best if is_person(best.confidence, network.joint_set) else None


def _centre(network: CropNetwork, frame: Frame, look: _Look) -> _Look:
    """The same person from crops that fit better and better."""
    spec = network.manifest.input
    for wider in _AGAIN:
        box = look.box()
        if box is None:
            return look
        look = _look(network, frame, [Crop.around(box, spec.size, wider * spec.padding)])[0]
    return look


def _whole(frame: Frame) -> Box:
    height, width = frame.shape[:2]
    return -0.5, -0.5, width - 0.5, height - 0.5


def _windows(frame: Frame, size: tuple[int, int]) -> Iterator[Crop]:
    """The whole image, and overlapping windows of the input's shape in smaller sizes."""
    left, top, right, bottom = _whole(frame)
    whole = Crop.around((left, top, right, bottom), size)
    yield whole
    longer = max(frame.shape[:2])
    for scale in _SCALES:
        width = scale * longer * min(1.0, size[1] / size[0])
        height = width * size[0] / size[1]
        for x in _places(left, right, width):
            for y in _places(top, bottom, height):
                if width < 0.99 * whole.width:
                    yield Crop((x, y), width, size)


def _places(low: float, high: float, length: float) -> list[float]:
    """Middles of windows that cover a range, half a window apart."""
    if length >= high - low:
        return [0.5 * (low + high)]
    count = int(np.ceil((high - low - length) / (_STEP * length))) + 1
    return [float(v) for v in np.linspace(low + 0.5 * length, high - 0.5 * length, count)]


def _look(network: CropNetwork, frame: Frame, crops: list[Crop]) -> list[_Look]:
    found = network.estimate(np.stack([crop.cut(frame) for crop in crops]))
    looks = []
    for row, crop in enumerate(crops):
        pose = None if found.joints3d is None else found.joints3d[row]
        others = None
        if found.candidates is not None:
            places, support = found.candidates.places[[row]], found.candidates.support[[row]]
            others = Candidates(crop.to_image(places), support)
        points = crop.to_image(found.joints2d[row])
        looks.append(_Look(crop, points, found.confidence[row], pose, others))
    return looks


def _settled(looks: list[_Look | None], joint_set: JointSet) -> list[_Look | None]:
    """The same looks with sides that motion allows, wherever somebody is followed."""
    order = joint_set.mirrored()
    settled: list[_Look | None] = []
    for _, group in groupby(looks, key=lambda look: look is None):
        run = list(group)
        seen = [look for look in run if look is not None]
        settled += _settle(seen, order) if seen else run
    return settled


def _settle(looks: list[_Look], order: tuple[int, ...]) -> list[_Look]:
    """The same for frames in a row."""
    track = Track(
        torch.stack([look.joints2d for look in looks]),
        torch.stack([look.confidence for look in looks]),
        join_candidates([look.candidates for look in looks]),
        torch.tensor([max(look.crop.width, look.crop.height) for look in looks]),
    )
    track, exchanged = settle_sides(track, order)
    settled = []
    for row, look in enumerate(looks):
        pose = look.joints3d
        if pose is not None and exchanged[row]:
            pose = pose[list(order)]
        points, confidence = track.points[row], track.confidence[row]
        settled.append(replace(look, joints2d=points, confidence=confidence, joints3d=pose))
    return settled


def _in_camera_axes(looks: list[_Look | None], camera: Camera) -> list[_Look | None]:
    """The same looks with 3D joints turned from the ray through their crop to the camera."""
    centers = [(0.0, 0.0) if look is None else look.crop.center for look in looks]
    pixels = torch.tensor(centers, dtype=camera.intrinsics.dtype)[:, None, None]
    turns = toward(camera.to_plane(pixels)[:, 0, 0]).float()
    return [
        look
        if look is None or look.joints3d is None
        else replace(look, joints3d=look.joints3d @ turn.mT)
        for look, turn in zip(looks, turns, strict=True)
    ]


def _to_detections(looks: list[_Look | None], joint_set: JointSet) -> Detections:
    """Looks of F frames as detections of the landmarks, (F, 1)."""
    joints = len(joint_set)
    nothing = torch.zeros(joints, 2), torch.zeros(joints)
    points = torch.stack([nothing[0] if look is None else look.joints2d for look in looks])
    trust = torch.stack([nothing[1] if look is None else look.confidence for look in looks])
    joints2d, confidence = map_to_landmarks(points, trust, joint_set)
    seen = [look is not None and look.joints3d is not None for look in looks]
    if not any(seen):
        return Detections.from_joints(joints2d[:, None], confidence[:, None])
    zero3d = torch.zeros(joints, 3)
    poses = torch.stack(
        [zero3d if look is None or look.joints3d is None else look.joints3d for look in looks]
    )
    joints3d, complete = _positions(poses, joint_set)
    trusted = torch.tensor(seen) & complete
    return Detections(joints2d[:, None], confidence[:, None], joints3d[:, None], trusted[:, None])


def _positions(poses: Tensor, joint_set: JointSet) -> tuple[Tensor, Tensor]:
    """3D landmarks (F, 16, 3) about the middle of the hips, and which frames have all of them."""
    known = poses.isfinite().all(-1)
    mapped, seen = map_to_landmarks(poses, known.to(poses), joint_set)
    hips = [LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip")]
    root = mapped[:, hips].mean(1, keepdim=True)
    there = seen > 0
    return torch.where(there[..., None], mapped - root, 0), there.all(-1)
