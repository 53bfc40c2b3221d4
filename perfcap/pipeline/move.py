"""A person's motion from joints: the stages of a capture before images are looked at."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import compose_rotvec, matrix_to_rotvec
from perfcap.io.doctor.finding import doubting
from perfcap.io.pose_prior import load_pose_prior
from perfcap.pipeline.bone_lengths import solve_bone_lengths
from perfcap.pipeline.checkpoint import Checkpoint, tensors
from perfcap.pipeline.clip_problem import ClipProblem, Term
from perfcap.pipeline.clock import Clock
from perfcap.pipeline.far_limbs import without_far_limbs
from perfcap.pipeline.floor import Floor
from perfcap.pipeline.gap_doubts import gap_doubts
from perfcap.pipeline.gaps import ranges
from perfcap.pipeline.images import Images
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.input_checks import require_matching
from perfcap.pipeline.input_doubts import scene_doubts
from perfcap.pipeline.look import Looked
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.own_energies import own_terms
from perfcap.pipeline.people import Person, Scene
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.prepare import prepare, relaxed
from perfcap.pipeline.preset_doubts import held_cameras, preset_doubts
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.result_doubts import doubts, joint_doubts, result_doubts
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.standing import Standing
from perfcap.pipeline.track_motion import WindowReport
from perfcap.pipeline.track_twice import track_twice
from perfcap.pipeline.trust import judge_motion


def move(
    scene: Scene,
    person: Person,
    config: CaptureConfig,
    until: Stage | None,
    *,
    energies: Mapping[str, Term] | None,
    level: bool,
    up: Tensor | None,
    clock: Clock,
    checkpoint: Checkpoint,
) -> Moved:
    """The stages of a person in a scene before images are looked at.

    Args:
        scene: where they are.
        person: one of its people.
        config: settings.
        until: the last stage, or all that the images allow.
        energies: an author's own.
        level: whether the result is in a world of the program's own choice.
        up: against gravity in the world of the cameras, where it is known.
        clock: of the stages.
        checkpoint: keeps finished work.
    """
    require_matching(scene.cameras, person.detections, scene.images)
    like = person.detections.joints2d  # 3D joints may be of another type
    person = replace(person, detections=person.detections.to(like).finite())
    until = _last_stage(until, scene.images)
    told = scene_doubts(scene, person, until.needs_images)
    person = replace(person, detections=doubting(person.detections, told.findings))
    said = (*scene.notes, *_unsaid(scene, config, until), *told.sentences)
    own = _own_terms(energies, until, level)
    start = _start(scene, person, config, clock, checkpoint)
    problem, motion = replace(start.problem, terms=own, up=_unit(up, like)), start.motion
    windows: list[WindowReport] = []
    if until >= Stage.TRACK_MOTION:
        with clock.stage("track_motion") as tell:
            motion, windows, problem = track_twice(problem, motion, tell, checkpoint)
    found = problem, start.problem, motion, windows, scene.images
    moved = Moved(start, person.detections, *found, until, clock, checkpoint, said)
    return _levelled(moved) if level else moved


def _unsaid(scene: Scene, config: CaptureConfig, until: Stage) -> Iterator[str]:
    """What the settings are not made for, where nobody has looked at the inputs yet."""
    if scene.images is None or not scene.images.examined:
        yield from preset_doubts(config, scene.cameras.views, until.needs_images)
        people = len(scene.people)
        yield from held_cameras(config, scene.cameras, people, until.needs_images)


def _unit(up: Tensor | None, like: Tensor) -> Tensor | None:
    """A direction (3,) of length one."""
    if up is None:
        return None
    length = up.norm() if isinstance(up, Tensor) and up.shape == (3,) else None
    if length is None or not 0 < float(length) < math.inf:
        raise InputError(
            f"up is {up!r:.80}; expected a tensor of three numbers, the direction against gravity"
        )
    unit: Tensor = (up / length).to(like)
    return unit


def _own_terms(
    energies: Mapping[str, Term] | None, until: Stage, level: bool
) -> Mapping[str, Term]:
    """An author's energies, if they can act in this capture."""
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
    return own


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

    def performance(self, looked: Looked) -> Performance:
        """The result, with what images added."""
        start, problem, judged = (
            self.start,
            looked.seen_by(self.problem),
            looked.seen_by(self.judged),
        )
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
                *joint_doubts(
                    self.detections, self.windows, self.images.names if self.images else None
                ),
                *doubts(looked),
                *result_doubts(problem, looked.motion, start.bones is not None),
                *gap_doubts(looked.motion.translation.detach(), ranges(~start.seen), problem.rate),
            ),
            surface=looked.surface,
            refinement=looked.refinement,
            contours=looked.contours,
            floor=None if problem.standing is None else problem.standing.floor,
            contact=None if problem.standing is None else problem.standing.feet,
            trust=without_far_limbs(
                judge_motion(judged, looked.motion, self.motion),
                judged,
                (looked.motion, self.motion),
                self.images.names if self.images else None,
            ),
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
    scene: Scene, person: Person, config: CaptureConfig, clock: Clock, checkpoint: Checkpoint
) -> _Start:
    like = person.detections.joints2d
    actor = copy.deepcopy(person.actor).to(like)  # a module moves in place, and it is the caller's
    if not config.pose.clavicles:
        actor = actor.with_still_shoulders()
    if not config.pose.rest_hands:
        actor = actor.with_modelled_hands()
    cameras = scene.cameras.to(like)
    frames = relaxed(FrameProblem.of(actor, cameras, person.detections, config.pose))
    bones: Tensor | None = None
    if person.solve_bones:
        with clock.stage("bone_lengths"):
            kept = checkpoint.kept("bone_lengths")
            (bones,) = kept.once(tensors(like), lambda: (solve_bone_lengths(frames),))
            frames = replace(frames, actor=actor.resized(bones))
    with clock.stage("initialize"):
        prepared = prepare(frames)
        motion, seen = initialize(prepared, checkpoint)
    problem = with_known_poses(ClipProblem.of(prepared.problem, scene.rate))
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


# --- A world of its own choice: y is up, and the floor that feet stand on at y = 0 ----------------


def _levelled(moved: Moved) -> Moved:
    transform, images = _to_level(moved.problem), moved.images
    if images is not None:
        images = replace(images, cameras=moved_cameras(images.cameras, transform))
    return replace(
        moved,
        motion=moved_motion(moved.motion, transform),
        problem=_moved_problem(moved.problem, transform),
        judged=_moved_problem(moved.judged, transform),
        images=images,
    )


def _to_level(problem: ClipProblem) -> Tensor:
    """Rigid transform (4, 4) from the world of a solved problem, one camera's own, to a level one.

    Without a floor, and where up is not known, the camera is taken to be held level: its y points
    down.
    """
    if problem.standing is not None:
        return problem.standing.floor.world_to_floor()
    if problem.up is not None:
        return Floor(problem.up, problem.up.new_zeros(()), 0.0, 0.0).world_to_floor()
    down = problem.pixel_unit.new_tensor([1.0, -1.0, -1.0, 1.0])
    return torch.diag(down)


def _moved_problem(problem: ClipProblem, transform: Tensor) -> ClipProblem:
    """The same problem in a world that a rigid transform (4, 4) leads to."""
    if problem.targets is not None:
        raise ValueError("targets are places in the world; move the problem before they are given")
    standing, up = problem.standing, problem.up
    return replace(
        problem,
        up=None if up is None else transform[:3, :3] @ up,
        cameras=moved_cameras(problem.cameras, transform),
        standing=None if standing is None else _moved_standing(standing, transform),
    )


def moved_motion(motion: Motion, transform: Tensor) -> Motion:
    """The same motion after a rigid transform (4, 4) of the world."""
    turn, shift = transform[:3, :3], transform[:3, 3]
    step = matrix_to_rotvec(turn).expand_as(motion.rotation)
    return replace(
        motion,
        translation=motion.translation @ turn.mT + shift,
        rotation=compose_rotvec(step, motion.rotation),
    )


def moved_cameras(cameras: Camera, transform: Tensor) -> Camera:
    """Cameras that see in the world after a rigid transform (4, 4) what they saw before."""
    turn, shift = transform[:3, :3].to(cameras.rotation), transform[:3, 3].to(cameras.rotation)
    rotation = cameras.rotation @ turn.mT
    return replace(cameras, rotation=rotation, translation=cameras.translation - rotation @ shift)


def _moved_standing(standing: Standing, transform: Tensor) -> Standing:
    turn, shift = transform[:3, :3], transform[:3, 3]
    normal = turn @ standing.floor.normal
    return replace(
        standing,
        floor=replace(standing.floor, normal=normal, height=standing.floor.height + normal @ shift),
        place=standing.place @ turn.mT + shift,
        shift=standing.shift @ turn.mT,
    )
