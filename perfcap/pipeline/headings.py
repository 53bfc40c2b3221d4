"""Poses of frames of which only one view's 2D joints are known: headings all around are tried."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix
from perfcap.geometry.triangulation import translation_from_plane
from perfcap.pipeline.checkpoint import NOTHING, Kept, motions
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.gaps import fill_gaps
from perfcap.pipeline.objective import angle_bounds, neutral_angles, pose_objective
from perfcap.solve import LevenbergMarquardt, solve

# --- Frames solved on their own: windows of one frame, all at once --------------------------------


def solve_frames(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    config: PoseConfig,
    pixel_unit: Tensor,
    start: Motion,
) -> tuple[Motion, Tensor]:
    """Solve frames as a batch of one-frame windows; returns the motion (F,) and energies (F,)."""
    single = detections.map(lambda each: each[:, None])
    objective = pose_objective(actor, cameras.apart(), single, config, pixel_unit, trajectory=None)
    initial = start.map(lambda each: each[:, None])
    method = LevenbergMarquardt(config.initial_steps, tolerance=config.initial_tolerance)
    solution = solve(objective, initial, method, angle_bounds(actor))
    state: Motion = solution.state
    return state.map(lambda each: each[:, 0]), solution.energy


# --------------------------------------------------------------------------------------------------
# Poses of frames of which only one view's 2D joints are known: headings all around are tried.

_YAWS = 8
_REACH = 5  # frames from a known one: so near, other headings are sooner left and right exchanged
_CLEARLY = 9.0  # energy of a joint three deviations off: less may be a matter of depth, by chance
_FEWEST, _ENOUGH = 3, 6  # joints that place a person, and that show a pose


def search_headings(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    config: PoseConfig,
    pixel_unit: Tensor,
    motion: Motion,
    known: Tensor,
    kept: Kept = NOTHING,
) -> tuple[Motion, Tensor]:
    """Poses for frames far from any that is known, each from the view that shows most joints.

    Eight headings are tried. The best is kept where it explains that view clearly better than what
    the pose between the frames that are known leads to; else that pose and its depth stay.
    Nothing is done where every frame is known.

    Args:
        actor: gives the joints.
        cameras: C views.
        detections: (F, C), prepared.
        config: of the pose.
        pixel_unit: one percent of the person's height in each view, (C,), pixels.
        motion: (F,); anything where it is not known.
        known: frames of which it is, (F,), bool.
        kept: keeps each batch of poses.

    Returns:
        motion: with the poses found, (F,).
        found: frames that are known now, (F,), bool.
    """
    views = _telling_views(detections) & ~_near(known)[:, None]
    between = fill_gaps(motion, known) if bool(known.any() & views.any()) else None
    motion, found = motion if between is None else between, known.clone()
    tasks = [
        (view, index)
        for view in torch.nonzero(views.any(0)).flatten().tolist()
        for index in torch.split(torch.nonzero(views[:, view]).flatten(), config.initial_batch)
    ]

    def solve(task: tuple[int, Tensor]) -> Motion:
        view, index = task
        some = replace(detections.frames(index).select([view]), joints3d=None)
        camera, unit = cameras.frames(index).select([view]), pixel_unit[[view]]
        pose, energy = _best_heading(actor, camera, some, config, unit)
        if between is None:
            return pose
        guess = between[index]
        _, rival = solve_frames(actor, camera, some, config, unit, guess)
        return pose.where(energy + _CLEARLY < rival.nan_to_num(torch.inf), guess)

    poses = kept.each(motions(motion.translation), solve, tasks)
    for (_, index), pose in zip(tasks, poses, strict=True):
        motion = _replaced(motion, index, pose)
        found[index] = torch.isfinite(pose.coordinates().frame).all(-1)
    return motion, found


def _telling_views(detections: Detections) -> Tensor:
    """The view that shows most joints of each frame, (F, C), if it shows enough of them.

    Enough are six, or as many as are ever seen: a close-up of the face has a pose as well.
    """
    count = (detections.confidence2d > 0).sum(-1)
    most = count.max(-1, keepdim=True)
    enough = most.values >= count.amax().clamp(_FEWEST, _ENOUGH)
    return torch.zeros_like(count, dtype=torch.bool).scatter(-1, most.indices, enough)


def _near(known: Tensor) -> Tensor:
    """Frames that are known or have one that is in reach, (F,), bool."""
    pool = torch.nn.functional.max_pool1d
    return pool(known.float()[None], 2 * _REACH + 1, stride=1, padding=_REACH)[0] > 0


def _replaced(motion: Motion, index: Tensor, pose: Motion) -> Motion:
    """The motion (F,) with other poses in some frames."""
    return motion.map(lambda own, other: own.index_copy(0, index, other), pose)


def _best_heading(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    config: PoseConfig,
    pixel_unit: Tensor,
) -> tuple[Motion, Tensor]:
    """Try headings all around in one view; the pose of least energy of every frame, and that."""
    best: tuple[Motion, Tensor] | None = None
    for turn in range(_YAWS):
        start = _standing_start(actor, cameras, detections, 2 * torch.pi * turn / _YAWS)
        motion, energy = solve_frames(actor, cameras, detections, config, pixel_unit, start)
        energy = energy.nan_to_num(torch.inf)
        if best is None:
            best = motion, energy
            continue
        best = motion.where(energy < best[1], best[0]), torch.minimum(energy, best[1])
    assert best is not None
    return best


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
