"""A motion to start from: every frame solved on its own, all frames at once."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.alignment import procrustes
from perfcap.geometry.camera import Camera
from perfcap.geometry.resection import translation_from_plane
from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix
from perfcap.geometry.triangulation import triangulate
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.gaps import fill_gaps
from perfcap.pipeline.objective import angle_bounds, neutral_angles, pose_objective
from perfcap.pipeline.prepare import Prepared
from perfcap.solve import LevenbergMarquardt, solve

_TRUNK = [LANDMARKS.index(n) for n in ("neck", "r_shoulder", "l_shoulder", "r_hip", "l_hip")]
_YAWS = 8  # headings tried where one view and no 3D joints leave the heading open
_MIN_VIEWS = 2
_FIT_POINTS = 3  # joints that fix a pose in space


def initialize(
    actor: Actor,
    cameras: Camera,
    prepared: Prepared,
    config: PoseConfig,
    pixel_unit: Tensor,
) -> tuple[Motion, Tensor]:
    """Minimise E_2d + E_3d frame by frame (Xu et al. 2018, Sec. 4; MPC-15).

    Where the joints' places in the world are roughly known (two views, or 3D joints) the root
    starts from a rigid fit of the trunk. One view without 3D joints leaves the heading open: eight
    are tried and the best is kept.

    Args:
        actor: gives the joints.
        cameras: C views.
        prepared: detections of F frames.
        config: of the pose.
        pixel_unit: one percent of the person's height in each view, (C,), pixels.

    Returns:
        motion: (F,); frames that cannot be solved alone are filled from their neighbours.
        seen: frames in which somebody is detected, (F,), bool.
    """
    frames = prepared.detections.frame_count
    motions, solved, seen = [], [], []
    for start in range(0, frames, config.initial_batch):
        part = slice(start, start + config.initial_batch)
        some = prepared.frames(part)
        motion, known = _initialize_part(actor, cameras.frames(part), some, config, pixel_unit)
        motions.append(motion)
        solved.append(known & torch.isfinite(motion.coordinates().frame).all(-1))
        seen.append((some.detections.confidence2d > 0).flatten(1).sum(-1) >= _FIT_POINTS)
    whole = Motion(*(torch.cat(parts) for parts in zip(*map(_parts, motions), strict=True)))
    detected = torch.cat(seen)
    return fill_gaps(whole, torch.cat(solved) & detected), detected


def _parts(motion: Motion) -> tuple[Tensor, Tensor, Tensor]:
    return motion.translation, motion.rotation, motion.angles


def _initialize_part(
    actor: Actor, cameras: Camera, prepared: Prepared, config: PoseConfig, pixel_unit: Tensor
) -> tuple[Motion, Tensor]:
    """Motion (F,) of some frames, and which of them could be solved, (F,)."""
    points, weights = joint_places(cameras, prepared)
    known = (weights[..., _TRUNK] > 0).sum(-1) >= _FIT_POINTS
    detections = prepared.detections
    if not bool(known.any()) and detections.views == 1:  # no 3D joints, or none that are trusted
        motion = _best_heading(actor, cameras, detections, config, pixel_unit)
        return motion, torch.ones_like(known)
    start = trunk_start(actor, points, weights)
    if detections.views >= _MIN_VIEWS:
        wide = _widened(config)
        start, _ = _solve_frames(actor, cameras, detections, wide, pixel_unit, start)
    return _solve_frames(actor, cameras, detections, config, pixel_unit, start)[0], known


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


def _solve_frames(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    config: PoseConfig,
    pixel_unit: Tensor,
    start: Motion,
) -> tuple[Motion, Tensor]:
    """Solve frames as a batch of one-frame windows; returns the motion (F,) and energies (F,)."""
    single = _single_frames(detections)
    objective = pose_objective(
        actor, _single_camera(cameras), single, config, pixel_unit, trajectory=None
    )
    initial = Motion(start.translation[:, None], start.rotation[:, None], start.angles[:, None])
    method = LevenbergMarquardt(config.initial_steps, tolerance=config.initial_tolerance)
    solution = solve(objective, initial, method, angle_bounds(actor))
    state: Motion = solution.state
    motion = Motion(state.translation[:, 0], state.rotation[:, 0], state.angles[:, 0])
    return motion, solution.energy


def _best_heading(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    config: PoseConfig,
    pixel_unit: Tensor,
) -> Motion:
    """Try headings all around for every frame and keep the one of least energy."""
    best: tuple[Motion, Tensor] | None = None
    for turn in range(_YAWS):
        start = _standing_start(actor, cameras, detections, 2 * torch.pi * turn / _YAWS)
        motion, energy = _solve_frames(actor, cameras, detections, config, pixel_unit, start)
        energy = energy.nan_to_num(torch.inf)
        if best is None:
            best = motion, energy
            continue
        better = (energy < best[1])[:, None]
        kept = (
            torch.where(better, new, old)
            for new, old in (
                (motion.translation, best[0].translation),
                (motion.rotation, best[0].rotation),
                (motion.angles, best[0].angles),
            )
        )
        best = Motion(*kept), torch.minimum(energy, best[1])
    assert best is not None
    return best[0]


def _standing_start(actor: Actor, cameras: Camera, detections: Detections, yaw: float) -> Motion:
    """A person standing upright in the world axes of the first view, at a heading."""
    frames = detections.joints2d.shape[0]
    rotation = cameras.rotation[..., 0, :, :].expand(frames, 3, 3)
    # upright in the image: the camera's up, turned about it
    flip = rotation.new_tensor([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    turn = rotvec_to_matrix(rotation.new_tensor([0.0, yaw, 0.0]))
    angles = neutral_angles(actor).expand(frames, -1)
    turned = rotation.mT @ flip @ turn
    zero = rotation.new_zeros(frames, 3)
    rest = replace(actor.skeleton.rest_motion(frames), angles=angles)
    pose = Motion(zero, matrix_to_rotvec(turned), rest.angles)
    local = actor.joints(pose) @ rotation.mT
    plane = cameras.to_plane(detections.joints2d)[:, 0]
    shift, _ = translation_from_plane(local, plane, detections.confidence2d[:, 0])
    shift = shift.nan_to_num(3.0)
    shift = torch.cat((shift[:, :2], shift[:, 2:].clamp(min=0.5)), -1)
    origin = cameras.translation[..., 0, :].expand(frames, 3)
    world = ((shift - origin)[:, None] @ rotation)[:, 0]
    return Motion(world, pose.rotation, angles)


def _single_frames(detections: Detections) -> Detections:
    joints3d = detections.joints3d
    return Detections(
        detections.joints2d[:, None],
        detections.confidence2d[:, None],
        None if joints3d is None else joints3d[:, None],
        detections.trusted3d[:, None],
    )


def _single_camera(cameras: Camera) -> Camera:
    """Cameras (F, C) as a batch of one-frame windows (F, 1, C); fixed cameras unchanged."""
    if not cameras.moving:
        return cameras
    distortion = cameras.distortion
    return replace(
        cameras,
        intrinsics=cameras.intrinsics[:, None],
        rotation=cameras.rotation[:, None],
        translation=cameras.translation[:, None],
        distortion=None if distortion is None else distortion[:, None],
    )
