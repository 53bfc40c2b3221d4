"""The job: everybody in a scene, stage by stage, and nothing more."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, overload

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.forks import note_threads
from perfcap.geometry.camera import Camera
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.clip_notes import clip_notes
from perfcap.pipeline.clip_problem import Term
from perfcap.pipeline.clock import Clock, Progress, notebook_progress, shared_stage
from perfcap.pipeline.images import Images
from perfcap.pipeline.input_checks import require_flags, require_kinds
from perfcap.pipeline.input_doubts import exchanged_actors
from perfcap.pipeline.look import Looked, look, parted
from perfcap.pipeline.move import Moved, move
from perfcap.pipeline.people import Person, Scene
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.refine import ImageJob, Moving, StageContext
from perfcap.pipeline.same_capture import require_same_capture
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.surroundings import axis, upright_axis, upright_together
from perfcap.rates import Timed, frame_rate


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
    up: Tensor | None = None,
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
    *,
    images: Images | None = None,
    solve_bones: bool | None = None,
    **options: Any,
) -> Performance | tuple[Performance, ...]:
    """Motion and surface of one person from detections and images (Xu et al. 2018), or of several.

    One view or several, fixed cameras or moving: the same stages. Computes in the type and on the
    device of the detections. Of a ``Scene`` with several people the results are in their order:
    motions are found one by one, silhouettes together (Liu et al. 2013, Sec. 5). It has cameras,
    detections, rate, images and ``solve_bones`` of its own. One person is a tuple of one, with the
    same bits. What a user should know is in ``warnings`` of the result, and printed nowhere.

    Args:
        actor: the rigged person; or a scene.
        cameras: C views, (C,) or (F, C), in pixels of the detections.
        detections: (F, C, 16).
        rate: frames a second, or the clip that has them.
        config: weights and sizes; the measured defaults when not given.
        images: the frames that were detected in, for the stages that refine pose and surface;
            before those, they are only asked whether the joints are theirs.
        until: the last stage to run; all that images, or their absence, allow when not given.
        energies: your own energies by name, see ``Term``: they act in the windows beside the
            others, and ``run.json`` reports their share of every frame.
        solve_bones: find the person's bone lengths first and capture on an actor that has them;
            for an actor that is not the person.
        level: the world of the cameras means nothing, as that of one assumed camera: the result
            is in another, with y up and the floor that feet stand on at y = 0.
        up: the direction against gravity in the world of the cameras, (3,), where it is known; else
            the floor is as the person stands on it.
        workers: threads of the stages that look at images; all cores when not given. Results do
            not depend on it.
        progress: told how far each stage is; in a notebook a line below the cell says so if nobody
            else is told.
        checkpoint: keeps finished blocks of every stage; what it holds of an earlier call with the
            same arguments is not computed again, and the result has the same bits. Only images,
            ``until`` and ``workers`` may differ (the caller vouches for images, and for what
            energies of one name compute); a folder with the work of another capture is refused.
        **options: those named above, by keyword.

    Raises:
        InputError: nobody is detected, the shapes do not fit, a stage needs images, the checkpoint
            is of another capture, or there are both energies of an author's own and a level world,
            or a scene and what it has.
    """
    if isinstance(actor, Scene):
        _require_once(
            **{"cameras": cameras, "detections": detections, "rate": rate},
            **{"images": images, "solve_bones": solve_bones},
        )
        return _capture_scene(actor, config, **options)
    if cameras is None or detections is None or rate is None:
        raise TypeError("capture takes a scene, or an actor with cameras, detections and rate")
    person = Person(actor, detections, False if solve_bones is None else solve_bones)
    number = frame_rate(rate)
    scene = Scene(cameras, (person,), number, images, clip_notes(rate, number))
    (found,) = _capture_scene(scene, config, **options)
    return found


def _require_once(**given: object) -> None:
    """Refuse beside a scene what it has."""
    twice = [name for name, value in given.items() if value is not None]
    if twice:
        raise InputError(
            f"a Scene has its own cameras, detections, rate and images, and each Person "
            f"solve_bones; got {', '.join(twice)} again: leave out what is here"
        )


def _capture_scene(
    scene: Scene,
    config: CaptureConfig | None = None,
    *,
    until: Stage | None = None,
    energies: Mapping[str, Term] | None = None,
    level: bool = False,
    up: Tensor | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> tuple[Performance, ...]:
    """Everybody in a scene: motions one by one, then what images add; see ``capture``."""
    note_threads()
    require_kinds(config=config, until=until, checkpoint=checkpoint)
    require_flags(level=level)
    if level and len(scene.people) > 1:
        raise InputError("level: is for one person; several need calibrated views, in one world")
    tell = progress or notebook_progress() or (lambda stage, done, total: None)
    kept, alone = checkpoint or NO_CHECKPOINT, len(scene.people) == 1
    config = config or CaptureConfig()
    names = sorted(map(str, energies)) if isinstance(energies, Mapping) else []
    require_same_capture(kept, scene, config=config, energies=names, level=level, up=up)
    moved = [
        move(
            *(scene, person, config, until),
            energies=energies,
            level=level,
            up=up,
            clock=Clock(tell if alone else _numbered(number, tell)),
            checkpoint=kept if alone else kept.of(f"person{number}"),
        )
        for number, person in enumerate(scene.people, 1)
    ]
    moved = [
        replace(each, told=each.told + more)
        for each, more in zip(moved, exchanged_actors(scene), strict=True)
    ]
    stage = partial(shared_stage, [each.clock for each in moved], tell)
    return _with_up(tuple(_looked(moved, stage, workers, kept)), level, up)


def _with_up(
    people: tuple[Performance, ...], level: bool, up: Tensor | None
) -> tuple[Performance, ...]:
    """The same with the axis that is up, where more is known than how each person lies or stands.

    Files of somebody who lies would otherwise be turned until they stood, each of a scene alone.
    """
    if level:  # the result's own world, whatever was known of that of the cameras
        known = axis("y")
    elif up is not None:
        known = upright_axis(up.detach())
    elif len(people) > 1:
        known = upright_together([each.joints() for each in people])
    else:
        return people
    return tuple(replace(each, up=known.to(each.detections.joints2d)) for each in people)


def _looked(
    moved: Sequence[Moved], stage: StageContext, workers: int | None, checkpoint: Checkpoint
) -> Iterator[Performance]:
    """What images add to the motions, where there are any."""
    first = moved[0]
    images, config, until = first.images, first.start.config, first.until
    people = [Moving(each.problem, each.motion, each.clock.stage, each.kept) for each in moved]
    if images is None or not until.needs_images:
        with torch.no_grad():
            looked = [Looked(motion) for motion in parted(people, config, stage)]
    else:
        looked = [*look(people, ImageJob(images, config, until, stage, workers, checkpoint))]
    for each, found in zip(moved, looked, strict=True):
        yield each.performance(found)


def _numbered(number: int, progress: Progress) -> Progress:
    return lambda stage, done, total: progress(f"person {number}: {stage}", done, total)
