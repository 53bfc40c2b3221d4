"""What an estimator of poses gives that a person cannot be, of its first clips."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections, extents
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.io.doctor.finding import ranges
from perfcap.io.doctor.legs import LEGS, NO_LEGS
from perfcap.pipeline.input_doubts import input_doubts
from perfcap.solve import Status

_SIZES = (0.7, 1.4)  # where a network says places, in a mean person's size
_SMALLEST, _LARGEST = 0.3, 4.0  # m, a pose from end to end
_BESIDE = {"l_toe": "l_ankle", "r_toe": "r_ankle"}
_ANKLES = [LANDMARKS.index(name) for name in ("r_ankle", "l_ankle")]
# Of a pose from end to end: errors of 3 cm leave 0.02 and 0.03 of the joint that is worst, of 15 cm
# 0.09 and 0.11; another order of the joints 0.04 and 0.2
_OFF, _OFF_ONE = 0.06, 0.15
_AT = 0.05  # m from a camera, which is inside of no person
_TURNED, _STEEP, _HEADLONG, _FEWEST = 1e-3, 0.5, 0.9, 5  # the last: poses that say something


def estimate_doubts(
    cameras: Camera, detections: Detections, missing: Collection[str], learned: bool = False
) -> tuple[str, ...]:
    """What ``input_doubts`` says of what an estimator gives; where its 3D poses are does not count.

    Args:
        cameras: C views, (C,) or (F, C).
        detections: (F, C); without 2D joints their confidence is 0.
        missing: landmarks that the estimator does not have.
        learned: whether confidences are still being learned, and may be next to nothing.
    """
    poses = relative_poses(detections, missing)
    if poses is None:
        return input_doubts(cameras, detections, not learned)
    told = input_doubts(cameras, replace(detections, joints3d=poses), not learned)
    seen = [place for place, name in enumerate(LANDMARKS) if name not in missing]
    told = (*told, *_odd_sizes(detections, seen))
    alone = not bool((detections.confidence2d > 0).any())
    return (*told, *_headlong(cameras, poses[detections.trusted3d])) if alone else told


def relative_poses(detections: Detections, missing: Collection[str]) -> Tensor | None:
    """3D poses (F, C, 16, 3) about their hips, with feet of no length where toes are missing."""
    if detections.joints3d is None:
        return None
    poses = detections.joints3d.detach()
    poses = poses - mid_hip(poses).unsqueeze(-2)
    for name, beside in _BESIDE.items():
        if name in missing:  # a foot without a length points nowhere
            poses[..., LANDMARKS.index(name), :] = poses[..., LANDMARKS.index(beside), :]
    return poses


def _odd_sizes(detections: Detections, seen: list[int]) -> Iterator[str]:
    """Some 3D poses (F, C) of another size than people have."""
    assert detections.joints3d is not None
    spans = extents(detections.joints3d[..., seen, :])
    odd = detections.trusted3d & ((spans < _SMALLEST) | (spans > _LARGEST))
    frames = odd.any(-1).nonzero().flatten().tolist()
    if 0 < 2 * len(frames) <= len(odd):  # of most frames others say so
        yield (
            f"3D joints of frames {ranges(frames)} span less than {_SMALLEST} or more than "
            f"{_LARGEST} m from end to end; check the unit of these frames"
        )


def empty_poses(empty: Tensor | None) -> Iterator[str]:
    """Frames (F,) of an estimator whose 3D joints are all in one place."""
    frames = [] if empty is None else empty.nonzero().flatten().tolist()
    if frames:
        yield (
            f"3D joints of frames {ranges(frames)} are all in one place, and count as missing; "
            "NaN says so of frames without a person"
        )


def lost_gradients(clips: Sequence[Detections]) -> Iterator[str]:
    """``eval`` of a whole network stops no gradients elsewhere, as where its statistics stay."""
    given = [part for each in clips for part in (each.joints2d, each.confidence2d, each.joints3d)]
    if torch.is_grad_enabled() and any(x is not None and x.requires_grad for x in given):
        yield (
            "it is in eval mode, in which joints that require gradients get none; call train() on "
            "it, or use torch.no_grad()"
        )


def unsolved(status: Sequence[int]) -> Iterator[str]:
    """Clips with windows that are where they started, as the worst status of each says."""
    lost = [clip for clip, worst in enumerate(status) if worst == Status.NOT_FINITE]
    if lost:
        yield (
            f"clips {ranges(lost)} were not solved everywhere: a window "
            f"{Status.NOT_FINITE.sentence}, and in energies of your own; such windows carry no "
            "gradient"
        )


def _headlong(cameras: Camera, poses: Tensor) -> Iterator[str]:
    """Whether 3D poses (N, 16, 3) of one view alone stand on their heads in its axes.

    A camera that does not turn is none: joints in a world of their own, whose axes do not matter.
    """
    turned = (cameras.rotation.detach() - torch.eye(3).to(cameras.rotation)).abs() > _TURNED
    if cameras.views > 1 or not bool(turned.any()) or len(poses) < _FEWEST:
        return
    down = poses[:, _ANKLES].mean(1) - poses[:, LANDMARKS.index("neck")]
    share = float((down[:, 1] < -down.norm(dim=-1) * _STEEP).double().mean())
    if share > _HEADLONG:
        yield (
            f"the person of the 3D joints stands on their head in {share:.0%} of the frames, in "
            "the axes of the camera; expected x right, y down, z forward: joints of the world are "
            "taken there by cameras.to_camera"
        )


def size_doubts(actor: Actor, places: Tensor, certain: Tensor) -> Iterator[str]:
    """Whether joints that are placed in the world (F, C, 16, 3) are of a person of another size."""
    seen = torch.where(certain[..., None] > 0, places, torch.nan).detach().double().cpu()
    own, shown = (
        float(points[..., LEGS, :].diff(dim=-2).norm(dim=-1).sum((-2, -1)).nanmedian())
        for points in (actor.skeleton.rest_landmarks.detach().double().cpu(), seen)
    )
    if shown > NO_LEGS and not _SIZES[0] < own / shown < _SIZES[1]:
        yield (
            f"the actor's legs are {own / shown:.2g} times as long as those of the placed 3D "
            "joints; check their unit, and give the actor of this person"
        )


def _at_root(cameras: Camera, places: Tensor) -> bool:
    """Whether joints (F, C, 16, 3) have their hips in the camera, as those relative to a root."""
    away = (mid_hip(places) - cameras.centre.detach()).norm(dim=-1)
    return float(away.nanmedian()) < _AT


def place_doubts(cameras: Camera, places: Tensor, certain: Tensor, joints: Tensor) -> Iterator[str]:
    """Whether a solved person is far from 3D joints that nothing else says anything about.

    Args:
        cameras: C views, (C,) or (F, C).
        places: of the joints in the world, of each view, (F, C, 16, 3) m.
        certain: confidence of them, (F, C, 16).
        joints: landmarks of the person, (F, 16, 3).
    """
    seen, joints = torch.where(certain[..., None] > 0, places, torch.nan).detach(), joints.detach()
    size = extents(joints).median()
    if cameras.views > 1 and _at_root(cameras, seen):
        yield (
            "3D joints of several views are relative to a root, and nothing says where the person "
            "is, who is put between the cameras; give 2D joints as well, or 3D joints from the "
            "centre of each camera"
        )
        seen = seen - (mid_hip(seen) - mid_hip(joints).unsqueeze(-2)).unsqueeze(-2)
    off = (seen - joints.unsqueeze(-3)).norm(dim=-1) / size
    usual, single = float(off.nanmedian()), off.flatten(0, -2).nanmedian(0).values
    if usual > _OFF:
        yield (
            f"the person lies {usual:.0%} of their size from the 3D joints; check that these are "
            "in the order of the joint set and views agree, unless the estimator errs by as much"
        )
    elif bool((single > _OFF_ONE).any()):
        worst = int(single.nan_to_num(0).argmax())
        yield (
            f"the {LANDMARKS[worst]} lies {float(single[worst]):.0%} of the person's size from "
            "that of the 3D joints; check that these are in the order of the joint set, and x, y "
            "and z in metres"
        )
