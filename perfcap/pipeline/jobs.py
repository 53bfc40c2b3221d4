"""The jobs: lists of stages, and nothing more."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, overload

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.forks import note_threads
from perfcap.geometry.camera import Camera
from perfcap.pipeline.bone_lengths import solve_bone_lengths
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, tensors
from perfcap.pipeline.clip_problem import ClipProblem, Term, own_terms
from perfcap.pipeline.gaps import ranges
from perfcap.pipeline.image_checks import examine_images
from perfcap.pipeline.images import Images
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.input_checks import require_matching
from perfcap.pipeline.jitter import relaxed
from perfcap.pipeline.joint_paths import known_poses
from perfcap.pipeline.level import moved_cameras, moved_motion, moved_problem, to_level
from perfcap.pipeline.look import Looked, look
from perfcap.pipeline.notebook import notebook_progress
from perfcap.pipeline.objective import person_height, views_with_person
from perfcap.pipeline.people import Scene, one_by_one
from perfcap.pipeline.performance import Performance, StageReport
from perfcap.pipeline.prepare import prepare
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.track_motion import WindowReport
from perfcap.pipeline.track_twice import track_twice
from perfcap.pipeline.trust import frame_evidence, judge_frames
from perfcap.rates import Timed, frame_rate
from perfcap.solve import Status

# called with a stage's name, what is done and what there is to do
Progress = Callable[[str, int, int], None]


@overload
def capture(
    actor: Scene,
    *,
    config: CaptureConfig | None = None,
    until: Stage | None = None,
    energies: Mapping[str, Term] | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> tuple[Performance, ...]: ...


@overload
def capture(
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
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> Performance: ...


def capture(
    actor: Actor | Scene,
    cameras: Camera | None = None,
    detections: Detections | None = None,
    rate: float | Timed | None = None,
    config: CaptureConfig | None = None,
    **options: Any,
) -> Performance | tuple[Performance, ...]:
    """Motion and surface of one person from detections and images (Xu et al. 2018), or of several.

    One view or several, fixed cameras or moving: the same stages. Computes in the type and on the
    device of the detections. Of a ``Scene`` with several people, who are captured one by one, the
    results are in their order; it has cameras, detections, rate, images and ``solve_bones`` of its
    own. One person is a tuple of one, with the same bits.

    Args:
        actor: the rigged person; or a scene.
        cameras: C views, (C,) or (F, C), in pixels of the detections.
        detections: (F, C, 16).
        rate: frames a second, or the clip that has them.
        config: weights and sizes; the measured defaults when not given.
        images: the frames that were detected in, for the stages that refine pose and surface.
        until: the last stage to run; all that images, or their absence, allow when not given.
        energies: your own energies by name, see ``Term``: they act in the windows beside the
            others, and ``run.json`` reports their share of every frame.
        solve_bones: find the person's bone lengths first and capture on an actor that has them;
            for an actor that is not the person.
        level: the world of the cameras means nothing, as that of one assumed camera: the result
            is in another, with y up and the floor that feet stand on at y = 0.
        workers: threads of the stages that look at images; all cores when not given. Results do
            not depend on it.
        progress: told how far each stage is; in a notebook a line below the cell says so if nobody
            else is told.
        checkpoint: keeps finished blocks of every stage; what it holds of an earlier call with the
            same arguments is not computed again, and the result has the same bits.
        **options: those named above, by keyword.

    Raises:
        InputError: nobody is detected, the shapes do not fit, a stage needs images, or there are
            both energies of an author's own and a level world.
    """
    if isinstance(actor, Scene):
        return one_by_one(_capture_person, actor, config, **options)
    if cameras is None or detections is None or rate is None:
        raise TypeError("capture takes a scene, or an actor with cameras, detections and rate")
    return _capture_person(actor, cameras, detections, rate, config, **options)


def _capture_person(
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
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> Performance:
    """See ``capture``."""
    note_threads()
    rate = frame_rate(rate)
    require_matching(cameras, detections, images)
    detections = detections.to(detections.joints2d)  # 3D joints may be of another type
    until = _last_stage(until, images)
    told: tuple[str, ...] = ()
    if images is not None and until.needs_images and not images.examined:
        told = examine_images(images, cameras, detections)
    own = own_terms(energies)
    if own and level:
        raise InputError(
            f"energies {', '.join(own)} are of the world of the cameras, which level=True leaves; "
            "give one or the other"
        )
    clock = _Clock(progress or notebook_progress() or (lambda stage, done, total: None))
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
    looked = look(problem, motion, images, start.config, until, clock.stage, workers, kept)
    motion, refinement = looked.motion, looked.refinement
    return Performance(
        actor=problem.actor,
        cameras=problem.cameras,
        detections=detections,
        motion=motion,
        rate=rate,
        config=start.config,
        gaps=tuple(ranges(~start.seen)),
        windows=tuple(windows),
        stages=tuple(clock.stages),
        bone_scales=start.bones,
        warnings=(*told, *_blind_views(detections), *_warnings(windows), *_doubts(looked)),
        surface=looked.surface,
        refinement=refinement,
        contours=looked.contours,
        floor=None if problem.standing is None else problem.standing.floor,
        contact=None if problem.standing is None else problem.standing.feet,
        trust=judge_frames(frame_evidence(judged, motion)),
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
    clock: _Clock,
    checkpoint: Checkpoint,
) -> _Start:
    like = detections.joints2d
    cameras = cameras.to(like)
    actor = copy.deepcopy(actor).to(like)  # a module moves in place, and this one is the caller's
    pixel_unit = 0.01 * person_height(detections)
    pose = relaxed(config.pose, detections, pixel_unit)
    bones: Tensor | None = None
    if solve_bones:
        with clock.stage("bone_lengths"):
            kept = checkpoint.kept("bone_lengths")
            solved = partial(solve_bone_lengths, actor, cameras, detections, pose, pixel_unit)
            (bones,) = kept.once(tensors(like), lambda: (solved(),))
            actor = actor.resized(bones)
    with clock.stage("initialize"):
        prepared = prepare(actor, cameras, detections, pose.position.gate)
        motion, seen = initialize(actor, cameras, prepared, pose, pixel_unit, checkpoint)
    poses = known_poses(actor, pose, prepared.detections)
    problem = ClipProblem(actor, cameras, prepared.detections, pose, pixel_unit, rate, poses=poses)
    return _Start(problem, motion, seen, replace(config, pose=pose), bones)


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
    for view in torch.nonzero(~views_with_person(detections)).flatten().tolist():
        yield f"view {view}, counted from 0, detects nobody; the other views place the joints"


def _warnings(windows: list[WindowReport]) -> Iterator[str]:
    for report in windows:
        if report.status == Status.NOT_FINITE:
            yield (
                f"frames {report.window.start} to {report.window.stop - 1} could not be solved: "
                f"{report.status.sentence}"
            )


def _doubts(looked: Looked) -> Iterator[str]:
    """What the images did not show, or showed against the model."""
    refinement = looked.refinement
    if looked.contours is not None and looked.contours.doubtful.any():
        yield (
            f"in {int(looked.contours.doubtful.sum())} frames hardly any edge of the images lies "
            "along the body's outline: little light, blur, clothes like the background, or an "
            "actor of another size; there the motion is about that of the joints alone"
        )
    if refinement is None:
        return
    report = refinement.evidence.report()
    if report["scene_cuts"]:
        yield f"the scene changes at frames {report['scene_cuts']}; nothing is carried across"
    if report["nobody_in_view"]:
        yield (
            f"in {len(report['nobody_in_view'])} frames the person is outside every image; "
            "nothing refines them"
        )
    if report["cropped"]:
        yield (
            f"in {len(report['cropped'])} frames the border of an image cuts the person off; what "
            "lies outside follows as it can"
        )
    if report["no_contour"]:
        yield (
            f"in {len(report['no_contour'])} frames the masks are empty or fill the image; nothing "
            "refines them"
        )
    if report["doubtful_masks"]:
        yield (
            f"in {len(report['doubtful_masks'])} frames masks may be wrong: a network contradicts "
            "them; run.json names them (doubtful_masks)"
        )
    parts = (("motion", refinement.pose), ("surface", refinement.surface))
    for name, part in parts:
        if part is not None and not part.kept.all():
            yield (
                f"in {int((~part.kept).sum())} frames silhouettes did not improve the {name}; it "
                "is kept, or filled in from frames around them"
            )


@dataclass
class _Clock:
    """Times stages and tells that they start and end."""

    tell: Progress
    stages: list[StageReport] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[int, int], None]]:
        """Time a stage; gives what to tell its progress to."""
        self.tell(name, 0, 1)
        wall, cpu = time.perf_counter(), time.process_time()
        yield partial(self.tell, name)
        self.stages.append(StageReport(name, time.perf_counter() - wall, time.process_time() - cpu))
        self.tell(name, 1, 1)
