"""The jobs: lists of stages, and nothing more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, overload

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.pipeline.capture_scene import capture_scene
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.clip_problem import Term
from perfcap.pipeline.clock import Progress
from perfcap.pipeline.images import Images
from perfcap.pipeline.look import look
from perfcap.pipeline.move import move
from perfcap.pipeline.people import Scene
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.stage import Stage
from perfcap.rates import Timed


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
    device of the detections. Of a ``Scene`` with several people the results are in their order:
    motions are found one by one, silhouettes together (Liu et al. 2013, Sec. 5). It has cameras,
    detections, rate, images and ``solve_bones`` of its own. One person is a tuple of one, with the
    same bits.

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
            both energies of an author's own and a level world, or a scene and what it has.
    """
    if isinstance(actor, Scene):
        if not (cameras is None and detections is None and rate is None):
            raise InputError("a Scene has its own cameras, detections and rate; leave others out")
        return capture_scene(_capture_person, actor, config, **options)
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
    moved = move(
        *(actor, cameras, detections, rate, config),
        images=images, until=until, energies=energies, solve_bones=solve_bones, level=level,
        progress=progress, checkpoint=checkpoint,
    )  # fmt: skip
    looked = look(
        *(moved.problem, moved.motion, moved.images, moved.start.config),
        *(moved.until, moved.clock.stage, workers, moved.kept),
    )
    return moved.performance(looked)
