"""A motion to start from: every frame solved on its own, all frames at once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix
from perfcap.geometry.triangulation import translation_from_plane, triangulate
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, NOTHING, Checkpoint, Codec, Kept, motions
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.gaps import fill_gaps, require_somebody
from perfcap.pipeline.objective import FrameProblem, angle_bounds, neutral_angles
from perfcap.pipeline.placed_start import FIT_POINTS, TRUNK, placed_start, trunk_start
from perfcap.pipeline.prepare import Prepared
from perfcap.solve import LevenbergMarquardt, solve

_MIN_VIEWS = 2


def initialize(prepared: Prepared, checkpoint: Checkpoint = NO_CHECKPOINT) -> tuple[Motion, Tensor]:
    """Minimise E_2d + E_3d frame by frame (Xu et al. 2018, Sec. 4; MPC-15).

    Where the joints' places in the world are roughly known (two views, or 3D joints) the root
    starts from a rigid fit of the trunk; of several views limbs start as they hang and where these
    places are, and the lower minimum counts. Frames of which one view shows 2D joints only leave
    the heading open: eight are tried.

    Args:
        prepared: F frames.
        checkpoint: keeps every batch of frames.

    Returns:
        motion: (F,); frames that cannot be solved alone are filled from their neighbours.
        seen: frames in which somebody is detected, (F,), bool.

    Raises:
        InputError: no view shows the person in any frame.
    """
    detections, batch = prepared.detections, prepared.problem.config.initial_batch
    seen = (detections.confidence2d > 0).flatten(1).sum(-1) >= FIT_POINTS
    require_somebody(seen)  # before anything is kept
    starts = range(0, detections.frame_count, batch)
    tasks = [slice(start, start + batch) for start in starts]

    def solved_alone(part: slice) -> tuple[Motion, Tensor]:
        return _initialize_part(prepared.frames(part))

    codec = _parts_of(detections.joints2d)
    kept = checkpoint.kept("initialize").each(codec, solved_alone, tasks)
    solved, placed = [], []
    for motion, known in kept:
        solved.append(motion)
        placed.append(known & torch.isfinite(motion.coordinates().frame).all(-1))
    whole = Motion.cat(solved)
    known = torch.cat(placed) & seen
    more = checkpoint.kept("headings")
    found = search_headings(prepared.problem, whole, known, more)
    return fill_gaps(*found), seen


def _parts_of(like: Tensor) -> Codec[tuple[Motion, Tensor]]:
    """How some frames and what is known of them are kept."""
    motion = motions(like)

    def unpack(record: dict[str, Any]) -> tuple[Motion, Tensor]:
        known = torch.from_numpy(record.pop("known")).to(like.device)
        return motion.unpack(record), known

    return Codec(lambda part: {**motion.pack(part[0]), "known": part[1].numpy(force=True)}, unpack)


def _initialize_part(prepared: Prepared) -> tuple[Motion, Tensor]:
    """Motion (F,) of some frames, and in which of them joints' places are known, (F,)."""
    problem = prepared.problem
    points, weights = joint_places(prepared)
    known = (weights[..., TRUNK] > 0).sum(-1) >= FIT_POINTS
    start = trunk_start(problem.actor, points, weights)
    if not bool(known.any()):
        return start, known
    if problem.detections.views < _MIN_VIEWS:  # its 3D joints lead each limb on their own
        return solve_frames(problem, start)[0], known
    return _better_of_two(problem, start, points, (weights > 0).to(points)), known


def _better_of_two(problem: FrameProblem, start: Motion, points: Tensor, certain: Tensor) -> Motion:
    """Each frame solved from two poses, (F,); the lower minimum.

    Limbs that start as they hang are far from where they are: kernels are wider for a few steps,
    and still pixels catch some in wrong minima. Places of joints (F, 16, 3) lead limbs there, and
    are themselves wrong where two views are.
    """
    wide, _ = solve_frames(replace(problem, config=_widened(problem.config)), start)
    motion, energy = solve_frames(problem, wide)
    placed = placed_start(problem.actor, points[:, None], certain[:, None], problem.config)
    other, others = solve_frames(problem, placed)
    return other.where(others < energy.nan_to_num(torch.inf), motion)


def _widened(config: PoseConfig) -> PoseConfig:
    scale = config.reprojection.scale
    wide = None if scale is None else scale * config.initial_widening
    return replace(
        config,
        initial_steps=config.widened_steps,
        reprojection=replace(config.reprojection, scale=wide),
    )


def joint_places(prepared: Prepared) -> tuple[Tensor, Tensor]:
    """Rough places of the joints in the world, (F, 16, 3) m, and their weights, (F, 16).

    Triangulated where two or more views see a joint, lifted from the trusted 3D joints elsewhere.
    """
    cameras, detections = prepared.problem.cameras, prepared.detections
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


# --- Frames solved on their own: windows of one frame, all at once --------------------------------


def solve_frames(problem: FrameProblem, start: Motion) -> tuple[Motion, Tensor]:
    """Solve frames as a batch of one-frame windows; returns the motion (F,) and energies (F,)."""
    single = problem.detections.map(lambda each: each[:, None])
    objective = replace(problem, cameras=problem.cameras.apart(), detections=single).objective()
    initial = start.map(lambda each: each[:, None])
    config = problem.config
    method = LevenbergMarquardt(config.initial_steps, tolerance=config.initial_tolerance)
    solution = solve(objective, initial, method, angle_bounds(problem.actor))
    state: Motion = solution.state
    return state.map(lambda each: each[:, 0]), solution.energy


# --- Frames of which one view shows 2D joints only: headings all around are tried -----------------

_YAWS = 8
_REACH = 5  # frames from a known one: so near, other headings are sooner left and right exchanged
_CLEARLY = 9.0  # energy of a joint three deviations off: less may be a matter of depth, by chance
_FEWEST, _ENOUGH = 3, 6  # joints that place a person, and that show a pose


def search_headings(
    problem: FrameProblem, motion: Motion, known: Tensor, kept: Kept = NOTHING
) -> tuple[Motion, Tensor]:
    """Poses for frames far from any that is known, each from the view that shows most joints.

    Eight headings are tried. The best is kept where it explains that view clearly better than what
    the pose between the frames that are known leads to; else that pose and its depth stay.
    Nothing is done where every frame is known.

    Args:
        problem: the frames, prepared.
        motion: (F,); anything where it is not known.
        known: frames of which it is, (F,), bool.
        kept: keeps each batch of poses.

    Returns:
        motion: with the poses found, (F,).
        found: frames that are known now, (F,), bool.
    """
    batch = problem.config.initial_batch
    views = _telling_views(problem.detections) & ~_near(known)[:, None]
    between = fill_gaps(motion, known) if bool(known.any() & views.any()) else None
    motion, found = motion if between is None else between, known.clone()
    tasks = [
        (view, index)
        for view in torch.nonzero(views.any(0)).flatten().tolist()
        for index in torch.split(torch.nonzero(views[:, view]).flatten(), batch)
    ]

    def best_of(task: tuple[int, Tensor]) -> Motion:
        view, index = task
        some = problem.frames(index).view(view)
        some = replace(some, detections=replace(some.detections, joints3d=None))
        pose, energy = _best_heading(some)
        if between is None:
            return pose
        guess = between[index]
        _, rival = solve_frames(some, guess)
        return pose.where(energy + _CLEARLY < rival.nan_to_num(torch.inf), guess)

    poses = kept.each(motions(motion.translation), best_of, tasks)
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


def _best_heading(problem: FrameProblem) -> tuple[Motion, Tensor]:
    """Try headings all around in one view; the pose of least energy of every frame, and that."""
    best: tuple[Motion, Tensor] | None = None
    for turn in range(_YAWS):
        start = _standing_start(problem, 2 * torch.pi * turn / _YAWS)
        motion, energy = solve_frames(problem, start)
        energy = energy.nan_to_num(torch.inf)
        if best is None:
            best = motion, energy
            continue
        best = motion.where(energy < best[1], best[0]), torch.minimum(energy, best[1])
    assert best is not None
    return best


def _standing_start(problem: FrameProblem, yaw: float) -> Motion:
    """A person standing upright in the world axes of the first view, at a heading."""
    actor, cameras, detections = problem.actor, problem.cameras, problem.detections
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
