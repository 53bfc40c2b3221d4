"""What a pose estimator says, in the shapes that estimators say it in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections, extents, not_found, unit_of
from perfcap.detect.joint_checks import require_joints, require_shares
from perfcap.detect.joint_set import LANDMARKS, JointSet, map_to_landmarks
from perfcap.detect.retarget import bone_vectors, filled, mid_hip
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.camera_checks import require_usable
from perfcap.geometry.plain import goes_forwards
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.gaps import fill_gaps
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.input_checks import require_cameras
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.padded_clips import cut_clips
from perfcap.pipeline.placed_start import FIT_POINTS, placed_start
from perfcap.pipeline.prepare import prepare, relaxed

Clips = Tensor | Sequence[Tensor]
"""A clip (F, ...), a padded batch of them (B, F, ...), or a list of clips."""

_WITHIN = 0.2  # m, of the hips from a camera that would be inside of the person
_TOUCHING = 0.01  # m, likewise of any joint


@dataclass(frozen=True)
class ClipEstimate:
    """The estimates of one clip, mapped to the landmarks; what is missing has confidence 0.

    Attributes:
        cameras: C views, (C,) or (F, C).
        detections: (F, C). Without 2D joints their confidence is 0 everywhere.
        targets: places of the joints in the world, (F, C, 16, 3) m; None if they are not known.
        certain: confidence of the targets, (F, C, 16).
        empty: frames (F,) with 3D joints all in one place; None where there are none.
    """

    cameras: Camera
    detections: Detections
    targets: Tensor | None
    certain: Tensor
    empty: Tensor | None = None

    @property
    def frames(self) -> int:
        """F."""
        return self.detections.frame_count

    @property
    def has_pixels(self) -> bool:
        """Whether any joint is seen in an image."""
        return bool((self.detections.confidence2d > 0).any())


@dataclass(frozen=True)
class Raw:
    """What a caller gave; see ``PoseRefiner.forward``."""

    joints2d: Clips | None
    confidence2d: Clips | None
    joints3d: Clips | None
    placed: bool
    lengths: Tensor | Sequence[int] | None


def read_estimates(
    raw: Raw, cameras: Camera | Sequence[Camera], joint_set: JointSet, actor: Actor
) -> tuple[list[ClipEstimate], bool]:
    """Clips of an estimate in the type of the actor, and whether they came as a batch.

    Raises:
        InputError: nothing is given, or shapes do not fit each other, the joints or the cameras,
            or torch differentiates forwards.
    """
    _require_backward(raw)
    columns = {
        "joints2d": cut_clips("joints2d", raw.joints2d, 4, raw.lengths),
        "confidence2d": cut_clips("confidence2d", raw.confidence2d, 3, raw.lengths),
        "joints3d": cut_clips("joints3d", raw.joints3d, 4, raw.lengths),
    }
    given = {name: clips for name, clips in columns.items() if clips is not None}
    if "joints2d" not in given and "joints3d" not in given:
        raise InputError("PoseRefiner got neither joints2d nor joints3d; give at least one")
    counts = {name: len(clips) for name, (clips, _) in given.items()}
    if len(set(counts.values())) != 1 or len({batched for _, batched in given.values()}) != 1:
        raise InputError(
            f"PoseRefiner got different numbers of clips: {counts}; give as many of each, all as "
            "a batch or all as one clip"
        )
    count = next(iter(counts.values()))
    views = _cameras(cameras, count)
    clips = [
        _estimate(
            {name: parts[i] for name, (parts, _) in given.items()},
            views[i].to(actor.skeleton.lower),
            joint_set,
            raw.placed or "joints2d" not in given,
            actor,
        )
        for i in range(count)
    ]
    return clips, next(iter(given.values()))[1]


def _require_backward(raw: Raw) -> None:
    """Refuse transforms of functions, whose derivatives would be others than those of ``backward``.

    Raises:
        InputError: this is one, or joints have tangents.
    """
    given: list[object] = []
    for part in (raw.joints2d, raw.confidence2d, raw.joints3d):
        given += part if isinstance(part, list | tuple) else [part]
    if goes_forwards(*(each for each in given if isinstance(each, Tensor))):
        raise InputError(
            "PoseRefiner cannot run inside of torch.func.jvp, jacfwd and the like, or forward-mode "
            "differentiation; take gradients by backward()"
        )


def _cameras(cameras: Camera | Sequence[Camera], count: int) -> list[Camera]:
    require_cameras(cameras)
    if isinstance(cameras, Camera):
        if cameras.moving and 1 < count == len(cameras.intrinsics):
            raise InputError(
                f"cameras are {count} times those of all views, for {count} clips: one a clip, or "
                "one a frame of every clip? Give a list with one Camera for each clip"
            )
        return [cameras] * count
    if len(cameras) != count:
        raise InputError(
            f"PoseRefiner got {len(cameras)} cameras for {count} clips; give one Camera for all, "
            "or a list with one for each clip"
        )
    return list(cameras)


def _estimate(
    given: dict[str, Tensor], cameras: Camera, joint_set: JointSet, placed: bool, actor: Actor
) -> ClipEstimate:
    like = actor.skeleton.lower
    given = {name: clip.to(like) for name, clip in given.items()}
    shapes = {name: tuple(clip.shape) for name, clip in given.items()}
    frames, views = next(iter(shapes.values()))[:2]
    expected = {"joints2d": (len(joint_set), 2), "joints3d": (len(joint_set), 3)}
    expected["confidence2d"] = (len(joint_set),)  # type: ignore[assignment]
    wanted = {name: (frames, cameras.views, *expected[name]) for name in shapes}
    if shapes != wanted:
        raise InputError(
            f"a clip has {shapes}, expected {wanted}: {cameras.views} views and the "
            f"{len(joint_set)} joints of {joint_set.name!r}; add the view axis, or name the joint "
            "set of the estimator"
        )
    require_usable("cameras", cameras, frames)
    if "confidence2d" in given:
        require_shares(given["confidence2d"])
    whole = (frames, views, len(LANDMARKS))
    pixels, seen = like.new_zeros(*whole, 2), like.new_zeros(whole)
    if "joints2d" in given:
        flat = given["joints2d"]
        confidence = given.get("confidence2d", torch.ones_like(flat[..., 0]))
        pixels, seen = map_to_landmarks(flat, confidence, joint_set)
    detections = Detections.from_joints(pixels, seen)
    require_joints(detections)
    if "joints3d" not in given:
        return ClipEstimate(cameras, detections, None, like.new_zeros(whole))
    lengths = bone_vectors(actor.skeleton.rest_landmarks.detach()).norm(dim=-1)
    clip = ClipEstimate(cameras, detections, None, seen)
    return _with_places(clip, given, joint_set, placed, lengths)


def _with_places(
    clip: ClipEstimate,
    given: dict[str, Tensor],
    joint_set: JointSet,
    placed: bool,
    lengths: Tensor,
) -> ClipEstimate:
    """Add 3D joints: a pose is used as a whole, where all joints that the set has are finite.

    Landmarks that it lacks are filled in, so that bones beyond them lead to the joints it has.

    Poses whose joints are all in one place show no person, as zeros in frames without one.
    """
    local = given["joints3d"]
    if "confidence2d" in given:
        somebody = (local != 0).flatten(-2).any(-1, keepdim=True)
        missing3d = not_found(local, given["confidence2d"]) & somebody
        local = torch.where(missing3d[..., None], torch.nan, local)
    sure = torch.ones_like(local[..., 0])
    if "joints2d" not in given:  # whose confidence it would be otherwise
        sure = given.get("confidence2d", sure)
    _, certain = map_to_landmarks(local, sure, joint_set)
    local, finite = map_to_landmarks(local, torch.ones_like(sure), joint_set)
    missing = joint_set.missing()
    visible = [name not in missing for name in LANDMARKS]
    whole = (finite[..., visible] > 0).all(-1)
    spans = extents(local[..., visible, :])
    _require_metres(spans[whole].detach())
    nobody = whole & (spans == 0)
    whole, certain = whole & ~nobody, torch.where(nobody[..., None], 0, certain)
    poses = local[whole]
    local = filled(local, lengths, missing)
    detections = replace(clip.detections, joints3d=local, trusted3d=whole)
    targets = None
    if placed and "joints2d" in given:  # joints alone may be in a world of their own
        _require_places(poses[:, visible], mid_hip(poses))
    if placed:
        cameras = clip.cameras
        targets = (local - cameras.translation.unsqueeze(-2)) @ cameras.rotation
    return replace(
        clip, detections=detections, targets=targets, certain=certain, empty=nobody.any(-1)
    )


def _require_places(poses: Tensor, hips: Tensor) -> None:
    """Refuse poses (N, J, 3) that the camera would be inside of: they are relative to a root.

    Args:
        poses: the joints that are given.
        hips: the middle of their hips, (N, 3).

    Raises:
        InputError: their hips, or any one joint, are where the camera is in most frames.
    """
    away, joints = hips.detach().norm(dim=-1), poses.detach().norm(dim=-1)
    if not len(poses):
        return
    if float(away.median()) < _WITHIN or float(joints.median(0).values.min()) < _TOUCHING:
        raise InputError(
            f"joints3d are placed, but the camera is inside of the person (their hips are "
            f"{100 * float(away.median()):.2g} cm from it): they look relative to a root; give "
            "them in the axes of the camera, from its centre, or leave placed=False"
        )


def _require_metres(spans: Tensor) -> None:
    """Refuse poses of a size that no person has, (N,), from end to end."""
    if not len(spans):
        return
    extent = float(spans.median())
    if extent == 0:
        raise InputError(
            "joints3d are all in one place in most frames, expected poses; say with lengths which "
            "frames are padding"
        )
    if (unit := unit_of(extent)) != "metres":
        raise InputError(
            f"joints3d span {extent:.3g} from end to end, expected metres; they look like {unit}: "
            "scale them first"
        )


# --- Where the solve of an estimate begins: every frame of a clip on its own ----------------------


@torch.no_grad()
def start_clip(
    actor: Actor, clip: ClipEstimate, config: PoseConfig, rate: float
) -> tuple[ClipProblem, Motion]:
    """The problem of a clip, and every frame of it solved on its own, (F,).

    Of the problem, detections, targets and cameras carry the graph of the estimate, nothing else.

    Raises:
        InputError: nobody is detected in the whole clip, or the actor's joints were changed.
    """
    frames = FrameProblem.of(actor, clip.cameras, clip.detections, config)
    judged = frames
    if clip.targets is not None:
        judged = replace(frames, detections=replace(clip.detections, joints3d=clip.targets))
    calm = relaxed(judged).config.trajectory.weight / config.trajectory.weight
    known = ClipProblem.of(frames, rate)
    problem = replace(known, targets=clip.targets, certain=clip.certain, calm=calm)
    if clip.has_pixels or clip.targets is None:
        prepared = prepare(frames)
        motion, _ = initialize(prepared)
        trusted = prepared.detections.trusted3d
        return replace(problem, detections=replace(clip.detections, trusted3d=trusted)), motion
    motion = placed_start(actor, clip.targets, clip.certain, config)
    return problem, fill_gaps(motion, (clip.certain.sum(1) > 0).sum(-1) >= FIT_POINTS)
