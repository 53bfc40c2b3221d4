"""The jobs: lists of stages, and nothing more."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.pipeline.bone_lengths import solve_bone_lengths
from perfcap.pipeline.gaps import ranges
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.jitter import relaxed
from perfcap.pipeline.objective import person_height
from perfcap.pipeline.performance import Performance, StageReport
from perfcap.pipeline.prepare import prepare
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.track_motion import MotionProblem, WindowReport, track_motion
from perfcap.solve import Status

# called with a stage's name, what is done and what there is to do
Progress = Callable[[str, int, int], None]


def capture(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    rate: float,
    config: CaptureConfig | None = None,
    *,
    until: Stage = Stage.TRACK_MOTION,
    solve_bones: bool = False,
    progress: Progress | None = None,
) -> Performance:
    """Skeleton motion of one person from joint detections (Xu et al. 2018, Sec. 4).

    One view or several, fixed cameras or moving: the same stages. Computes in the type and on the
    device of the detections.

    Args:
        actor: the rigged person.
        cameras: C views, (C,) or (F, C), in pixels of the detections.
        detections: (F, C, 16).
        rate: frames a second.
        config: weights and sizes; the measured defaults when not given.
        until: the last stage to run.
        solve_bones: find the person's bone lengths first and capture on an actor that has them;
            for an actor that is not the person.
        progress: told how far each stage is.

    Raises:
        InputError: nobody is detected, or the shapes do not fit.
    """
    config = config or CaptureConfig()
    tell = progress or (lambda stage, done, total: None)
    clock = _Clock(tell)
    like = detections.joints2d
    cameras = cameras.to(like)
    actor = copy.deepcopy(actor).to(like)  # a module moves in place, and this one is the caller's
    pixel_unit = 0.01 * person_height(detections)
    config = replace(config, pose=relaxed(config.pose, detections, pixel_unit))
    pose = config.pose
    bones: Tensor | None = None
    if solve_bones:
        with clock.stage("bone_lengths"):
            bones = solve_bone_lengths(actor, cameras, detections, pose, pixel_unit)
            actor = actor.resized(bones)
    with clock.stage("initialize"):
        prepared = prepare(actor, cameras, detections, pose.position.gate)
        motion, seen = initialize(actor, cameras, prepared, pose, pixel_unit)
    windows: list[WindowReport] = []
    if until >= Stage.TRACK_MOTION:
        with clock.stage("track_motion"):
            problem = MotionProblem(actor, cameras, prepared.detections, pose, pixel_unit, rate)
            motion, windows = track_motion(
                problem, motion, lambda done, total: tell("track_motion", done, total)
            )
    return Performance(
        actor=actor,
        cameras=cameras,
        detections=detections,
        motion=motion,
        rate=rate,
        config=config,
        gaps=tuple(ranges(~seen)),
        windows=tuple(windows),
        stages=tuple(clock.stages),
        bone_scales=bones,
        warnings=tuple(_warnings(windows)),
    )


def _warnings(windows: list[WindowReport]) -> Iterator[str]:
    for report in windows:
        if report.status == Status.NOT_FINITE:
            yield (
                f"frames {report.window.start} to {report.window.stop - 1} could not be solved: "
                f"{report.status.sentence}"
            )


@dataclass
class _Clock:
    """Times stages and tells that they start and end."""

    tell: Progress
    stages: list[StageReport] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        self.tell(name, 0, 1)
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        self.stages.append(StageReport(name, time.perf_counter() - wall, time.process_time() - cpu))
        self.tell(name, 1, 1)
