"""A motion to start from: every frame solved on its own, all frames at once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.alignment import procrustes
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import matrix_to_rotvec
from perfcap.geometry.triangulation import triangulate
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, Codec, motions
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.gaps import fill_gaps, require_somebody
from perfcap.pipeline.headings import search_headings, solve_frames
from perfcap.pipeline.objective import neutral_angles
from perfcap.pipeline.prepare import Prepared

_TRUNK = [LANDMARKS.index(n) for n in ("neck", "r_shoulder", "l_shoulder", "r_hip", "l_hip")]
_MIN_VIEWS = 2
_FIT_POINTS = 3  # joints that fix a pose in space


def initialize(
    actor: Actor,
    cameras: Camera,
    prepared: Prepared,
    config: PoseConfig,
    pixel_unit: Tensor,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> tuple[Motion, Tensor]:
    """Minimise E_2d + E_3d frame by frame (Xu et al. 2018, Sec. 4; MPC-15).

    Where the joints' places in the world are roughly known (two views, or 3D joints) the root
    starts from a rigid fit of the trunk. Frames of which one view shows 2D joints only leave the
    heading open: eight are tried.

    Args:
        actor: gives the joints.
        cameras: C views.
        prepared: detections of F frames.
        config: of the pose.
        pixel_unit: one percent of the person's height in each view, (C,), pixels.
        checkpoint: keeps every batch of frames.

    Returns:
        motion: (F,); frames that cannot be solved alone are filled from their neighbours.
        seen: frames in which somebody is detected, (F,), bool.

    Raises:
        InputError: no view shows the person in any frame.
    """
    detections = prepared.detections
    seen = (detections.confidence2d > 0).flatten(1).sum(-1) >= _FIT_POINTS
    require_somebody(seen)  # before anything is kept
    starts = range(0, detections.frame_count, config.initial_batch)
    tasks = [slice(start, start + config.initial_batch) for start in starts]

    def solve(part: slice) -> tuple[Motion, Tensor]:
        some = prepared.frames(part)
        return _initialize_part(actor, cameras.frames(part), some, config, pixel_unit)

    kept = checkpoint.kept("initialize").each(_parts_of(detections.joints2d), solve, tasks)
    solved, placed = [], []
    for motion, known in kept:
        solved.append(motion)
        placed.append(known & torch.isfinite(motion.coordinates().frame).all(-1))
    whole = Motion.cat(solved)
    known = torch.cat(placed) & seen
    more = checkpoint.kept("headings")
    found = search_headings(actor, cameras, detections, config, pixel_unit, whole, known, more)
    return fill_gaps(*found), seen


def _parts_of(like: Tensor) -> Codec[tuple[Motion, Tensor]]:
    """How some frames and what is known of them are kept."""
    motion = motions(like)

    def unpack(record: dict[str, Any]) -> tuple[Motion, Tensor]:
        known = torch.from_numpy(record.pop("known")).to(like.device)
        return motion.unpack(record), known

    return Codec(lambda part: {**motion.pack(part[0]), "known": part[1].numpy(force=True)}, unpack)


def _initialize_part(
    actor: Actor, cameras: Camera, prepared: Prepared, config: PoseConfig, pixel_unit: Tensor
) -> tuple[Motion, Tensor]:
    """Motion (F,) of some frames, and in which of them joints' places are known, (F,)."""
    points, weights = joint_places(cameras, prepared)
    known = (weights[..., _TRUNK] > 0).sum(-1) >= _FIT_POINTS
    start = trunk_start(actor, points, weights)
    if not bool(known.any()):
        return start, known
    detections = prepared.detections
    if detections.views >= _MIN_VIEWS:
        wide = _widened(config)
        start, _ = solve_frames(actor, cameras, detections, wide, pixel_unit, start)
    return solve_frames(actor, cameras, detections, config, pixel_unit, start)[0], known


def _widened(config: PoseConfig) -> PoseConfig:
    """Wider robust kernels for a few steps: limbs start at rest, which is far from where they are.

    One view does not need it, its 3D joints lead each limb on their own.
    """
    scale = config.reprojection.scale
    wide = None if scale is None else scale * config.initial_widening
    return replace(
        config,
        initial_steps=config.widened_steps,
        reprojection=replace(config.reprojection, scale=wide),
    )


def joint_places(cameras: Camera, prepared: Prepared) -> tuple[Tensor, Tensor]:
    """Rough places of the joints in the world, (F, 16, 3) m, and their weights, (F, 16).

    Triangulated where two or more views see a joint, lifted from the trusted 3D joints elsewhere.
    """
    detections = prepared.detections
    frames = detections.joints2d.shape[0]
    points = detections.joints2d.new_zeros(frames, len(LANDMARKS), 3)
    weights = points[..., 0]
    if prepared.lifted is not None:
        trust = detections.trusted3d.to(points)[..., None].expand(prepared.lifted.shape[:-1])
        weights = trust.amax(1)
        total = trust.sum(1).clamp(min=1e-9)[..., None]
        points = torch.where(trust[..., None] > 0, prepared.lifted, 0.0).sum(1) / total
    if detections.views >= _MIN_VIEWS:
        plane = cameras.to_plane(detections.joints2d)
        across, residual = triangulate(cameras, plane, detections.confidence2d)
        enough = torch.isfinite(across).all(-1) & torch.isfinite(residual)
        points = torch.where(enough[..., None], across, points)
        weights = torch.where(enough, 1.0, weights)
    return points, weights


def trunk_start(actor: Actor, points: Tensor, weights: Tensor) -> Motion:
    """Root from a rigid fit of the trunk; angles at the neutral pose."""
    skeleton = actor.skeleton
    rest = skeleton.rest_landmarks[_TRUNK]
    target, share = points[:, _TRUNK], weights[:, _TRUNK]
    fit = procrustes(
        rest.expand_as(target), torch.where(share[..., None] > 0, target, 0.0), share, scale=False
    )
    root = (fit.rotation @ skeleton.rest_positions[0]) + fit.translation
    angles = neutral_angles(actor).expand(len(points), -1)
    return Motion(root, matrix_to_rotvec(fit.rotation), angles)
