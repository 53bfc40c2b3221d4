"""What networks saw of one person, frame after frame, as detections."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import torch
from torch import Tensor

from perfcap.detect.candidates import join_candidates
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16, JointSet, map_to_landmarks
from perfcap.detect.look import CropNetwork, Look
from perfcap.detect.pose_fusion import Landmarks, exchanged, fuse, sides_differ
from perfcap.detect.sides import Track, settle_sides
from perfcap.detect.viewing_ray import toward
from perfcap.geometry.camera import Camera

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Seen:
    """What all networks see of the person in one frame; the first one followed."""

    look: Look
    others: tuple[Look | None, ...]


def combined(
    seen: list[Seen | None],
    network: CropNetwork,
    camera: Camera | None,
    others: Sequence[CropNetwork],
    poses: bool,
) -> Detections:
    """What all networks saw of one person, as one."""
    looks = [None if one is None else one.look for one in seen]
    own = _turned(_settled(looks, network.joint_set), network, camera)
    found = _to_detections(own, network)
    if not others:
        return found
    size = torch.tensor([0.0 if look is None else look.crop.height for look in looks])
    further = [_helped(other, place, seen, camera) for place, other in enumerate(others)]
    for other, marks in zip(others, further, strict=True):
        if sides_differ(_landmarks(marks), _landmarks(found), size.clamp(min=1.0)):
            _LOG.warning(
                "%s and %s call left and right differently, in nearly every frame; those of the "
                "first are used: check joints of their manifests",
                *(each.manifest.path.parent.name for each in (network, other)),
            )
    return _fused(found, further, size.clamp(min=1.0), poses)


def _helped(
    network: CropNetwork, place: int, seen: list[Seen | None], camera: Camera | None
) -> Detections:
    """What another network saw, with the sides as it saw them."""
    looks = [None if one is None else one.others[place] for one in seen]
    return _to_detections(_turned(looks, network, camera), network)


def _fused(
    first: Detections, others: Sequence[Detections], size: Tensor, poses: bool
) -> Detections:
    """One person's detections by several networks, each (F, 1), as one."""
    marks = [_landmarks(each) for each in (first, *others)]
    whole_body = fuse(marks[0], marks[1:], size)
    found = replace(
        first,
        joints2d=whole_body.joints2d[:, None],
        confidence2d=whole_body.confidence[:, None],
    )
    if not poses or bool(found.trusted3d.any()):
        return found
    for other, seen in zip(others, marks[1:], strict=True):
        if other.joints3d is not None and bool(other.trusted3d.any()):
            swapped = other.joints3d[:, :, list(LANDMARKS16.mirrored())]
            wrong = exchanged(seen, marks[0], size)[:, None, None, None]
            right = torch.where(wrong, swapped, other.joints3d)
            return replace(
                found, joints3d=right, trusted3d=other.trusted3d, deviation3d=other.deviation3d
            )
    return found


def _landmarks(found: Detections) -> Landmarks:
    return Landmarks(found.joints2d[:, 0], found.confidence2d[:, 0])


def _settled(looks: list[Look | None], joint_set: JointSet) -> list[Look | None]:
    """The same looks with sides that motion allows, wherever somebody is followed."""
    order = joint_set.mirrored()
    settled: list[Look | None] = []
    for _, group in groupby(looks, key=lambda look: look is None):
        run = list(group)
        seen = [look for look in run if look is not None]
        settled += _settle(seen, order) if seen else run
    return settled


def _settle(looks: list[Look], order: tuple[int, ...]) -> list[Look]:
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


def _turned(
    looks: list[Look | None], network: CropNetwork, camera: Camera | None
) -> list[Look | None]:
    """The same looks with 3D joints in the camera's axes, where a network gives the crop's."""
    if camera is None or not network.manifest.output.crop_axes:
        return looks
    centers = [(0.0, 0.0) if look is None else look.crop.center for look in looks]
    pixels = torch.tensor(centers, dtype=camera.intrinsics.dtype)[:, None, None]
    turns = toward(camera.to_plane(pixels)[:, 0, 0]).float()
    return [
        look
        if look is None or look.joints3d is None
        else replace(look, joints3d=look.joints3d @ turn.mT)
        for look, turn in zip(looks, turns, strict=True)
    ]


def _to_detections(looks: list[Look | None], network: CropNetwork) -> Detections:
    """Looks of F frames as detections of the landmarks, (F, 1)."""
    joint_set, error = network.joint_set, network.manifest.output.error3d
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
    joints3d, complete = landmark_positions(poses, joint_set)
    trusted = torch.tensor(seen) & complete
    return Detections(
        joints2d[:, None],
        confidence[:, None],
        joints3d[:, None],
        trusted[:, None],
        None if error is None else torch.full((len(looks), 1), error),
    )


def landmark_positions(poses: Tensor, joint_set: JointSet) -> tuple[Tensor, Tensor]:
    """3D landmarks (F, 16, 3) about the middle of the hips, and which frames have all of them.

    Args:
        poses: joints of the set (F, J, 3), metres, about any point; NaN where unknown.
        joint_set: names of the J joints.
    """
    known = poses.isfinite().all(-1)
    mapped, seen = map_to_landmarks(poses, known.to(poses), joint_set)
    hips = [LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip")]
    root = mapped[:, hips].mean(1, keepdim=True)
    there = seen > 0
    return torch.where(there[..., None], mapped - root, 0), there.all(-1)
