"""A person's motion from joints: the stages of a capture before images are looked at."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.forks import note_threads
from perfcap.geometry.camera import Camera
from perfcap.io.pose_prior import load_pose_prior
from perfcap.pipeline.bone_lengths import solve_bone_lengths
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, tensors
from perfcap.pipeline.clip_problem import ClipProblem, Term, own_terms
from perfcap.pipeline.clock import Clock, Progress, notebook_progress
from perfcap.pipeline.gaps import ranges
from perfcap.pipeline.images import Images
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.input_checks import examine_images, require_matching
from perfcap.pipeline.input_doubts import actor_doubts, input_doubts
from perfcap.pipeline.kinds import require_flags, require_kinds
from perfcap.pipeline.level import moved_cameras, moved_motion, moved_problem, to_level
from perfcap.pipeline.look import Looked
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.prepare import prepare, relaxed
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.result_doubts import doubts, result_doubts
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.track_motion import WindowReport
from perfcap.pipeline.track_twice import track_twice
from perfcap.pipeline.trust import frame_evidence, judge_frames
from perfcap.rates import Timed, frame_rate
from perfcap.solve import Status


def move(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    rate: float | Timed,
    config: CaptureConfig | None = None,
    *,
    images: Images | None = None,
    until: Stage | None = None,
    energies: Mapping[str, Term] | None = None,
    solve_bones: bool = False,
    level: bool = False,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> Moved:
    """The stages before images are looked at; arguments as of ``capture``."""
    note_threads()
    require_kinds(
        **{"actor": actor, "cameras": cameras, "detections": detections, "config": config},
        **{"images": images, "until": until, "checkpoint": checkpoint},
    )
    require_flags(solve_bones=solve_bones, level=level)
    rate = frame_rate(rate)
    require_matching(cameras, detections, images)
    detections = detections.to(detections.joints2d).finite()  # 3D joints may be of another type
    until = _last_stage(until, images)
    told = tuple(actor_doubts(actor, cameras, detections, solve_bones))
    if images is None or not images.examined:
        told += input_doubts(cameras, detections)
    if images is not None and until.needs_images and not images.examined:
        told += examine_images(images, cameras, detections)
    own = own_terms(energies)
    if own and level:
        raise InputError(
            f"energies {', '.join(own)} are of the world of the cameras, which level=True leaves; "
            "give one or the other"
        )
    if own and until < Stage.TRACK_MOTION:
        raise InputError(
            f"energies {', '.join(own)} act in the windows of track_motion, and until is "
            f"{until.name.lower()}, before there are any; give one or the other"
        )
    clock = Clock(progress or notebook_progress() or (lambda stage, done, total: None))
    kept = checkpoint or NO_CHECKPOINT
    settings = config or CaptureConfig()
    start = _start(actor, cameras, detections, rate, settings, solve_bones, clock, kept)
    problem, motion = replace(start.problem, terms=own), start.motion
    windows: list[WindowReport] = []
    if until >= Stage.TRACK_MOTION:
        with clock.stage("track_motion") as tell:
            motion, windows, problem = track_twice(problem, motion, tell, kept)
    judged = start.problem
    if level:
        transform = to_level(problem)
        motion = moved_motion(motion, transform)
        problem, judged = (moved_problem(each, transform) for each in (problem, judged))
        if images is not None:
            images = replace(images, cameras=moved_cameras(images.cameras, transform))
    about = images, until, clock, kept
    return Moved(start, detections, problem, judged, motion, windows, *about, told)


@dataclass(frozen=True)
class Moved:
    """A person whose motion is known from joints.

    Attributes:
        start: each frame on its own.
        detections: as given.
        problem: of the motion.
        judged: the same before a first solve.
        motion: (F,).
        windows: how their solves went.
        images: in the world of the motion.
        until: the last stage.
        clock: of the stages.
        kept: finished work.
        told: of the images, before anything was computed.
    """

    start: _Start
    detections: Detections
    problem: ClipProblem
    judged: ClipProblem
    motion: Motion
    windows: list[WindowReport]
    images: Images | None
    until: Stage
    clock: Clock
    kept: Checkpoint
    told: tuple[str, ...] = ()

    def unlooked(self) -> Performance:
        """The result of joints alone."""
        return self.performance(Looked(self.motion))

    def performance(self, looked: Looked) -> Performance:
        """The result, with what images added."""
        start, problem = self.start, self.problem
        return Performance(
            actor=problem.actor,
            cameras=problem.cameras,
            detections=self.detections,
            motion=looked.motion,
            rate=problem.rate,
            config=start.config,
            gaps=tuple(ranges(~start.seen)),
            windows=tuple(self.windows),
            stages=tuple(self.clock.stages),
            bone_scales=start.bones,
            warnings=(
                *self.told,
                *_blind_views(self.detections),
                *_warnings(self.windows),
                *doubts(looked),
                *result_doubts(
                    problem.actor,
                    problem.cameras,
                    looked.motion,
                    problem.rate,
                    start.bones is not None,
                ),
            ),
            surface=looked.surface,
            refinement=looked.refinement,
            contours=looked.contours,
            floor=None if problem.standing is None else problem.standing.floor,
            contact=None if problem.standing is None else problem.standing.feet,
            trust=judge_frames(frame_evidence(self.judged, looked.motion)),
        )


@dataclass(frozen=True)
class _Start:
    """Each frame on its own, and all that is needed to go on.

    Attributes:
        problem: of the motion.
        motion: (F,).
        seen: frames in which the person was detected, (F,).
        config: with weights that suit the detections.
        bones: logarithms of the bone lengths' scales, (S,), where they were solved.
    """

    problem: ClipProblem
    motion: Motion
    seen: Tensor
    config: CaptureConfig
    bones: Tensor | None


def _start(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    rate: float,
    config: CaptureConfig,
    solve_bones: bool,
    clock: Clock,
    checkpoint: Checkpoint,
) -> _Start:
    like = detections.joints2d
    cameras = cameras.to(like)
    actor = copy.deepcopy(actor).to(like)  # a module moves in place, and this one is the caller's
    if not config.pose.clavicles:
        actor = actor.with_still_shoulders()
    if not config.pose.rest_hands:
        actor = actor.with_modelled_hands()
    frames = relaxed(FrameProblem.of(actor, cameras, detections, config.pose))
    bones: Tensor | None = None
    if solve_bones:
        with clock.stage("bone_lengths"):
            kept = checkpoint.kept("bone_lengths")
            (bones,) = kept.once(tensors(like), lambda: (solve_bone_lengths(frames),))
            frames = replace(frames, actor=actor.resized(bones))
    with clock.stage("initialize"):
        prepared = prepare(frames)
        motion, seen = initialize(prepared, checkpoint)
    problem = with_known_poses(ClipProblem.of(prepared.problem, rate))
    return _Start(problem, motion, seen, replace(config, pose=frames.config), bones)


def with_known_poses(problem: ClipProblem) -> ClipProblem:
    """The problem with the shipped mixture of poses, where that is to count.

    Two views: from opposite sides they show depth by little else. One view has a lifter, which
    learned from the same recordings; more views need no such help.
    """
    if not problem.config.prior.poses or problem.detections.views != 2:
        return problem
    names = tuple(problem.actor.skeleton.angle_names)  # mixture and actor differ in their order
    return replace(problem, poses=load_pose_prior().ordered(names))


def _last_stage(until: Stage | None, images: Images | None) -> Stage:
    if until is None:
        return Stage.TRACK_MOTION if images is None else Stage.REFINE_SURFACE
    if until.needs_images and images is None:
        raise InputError(
            f"until is {until.name.lower()}, which looks at images, and there are none; give "
            "images, or end at track_motion"
        )
    return until


def _blind_views(detections: Detections) -> Iterator[str]:
    for view in torch.nonzero(~detections.views_with_person()).flatten().tolist():
        yield f"view {view}, counted from 0, detects nobody; the other views place the joints"


def _warnings(windows: list[WindowReport]) -> Iterator[str]:
    for report in windows:
        if report.status == Status.NOT_FINITE:
            yield (
                f"frames {report.window.start} to {report.window.stop - 1} could not be solved: "
                f"{report.status.sentence}"
            )
