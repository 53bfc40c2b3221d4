"""Everybody in a scene: motions one by one, silhouettes together."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from perfcap.errors import InputError
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.clock import Progress, shared_stage
from perfcap.pipeline.look import look_at_people
from perfcap.pipeline.move import Moved, move
from perfcap.pipeline.notebook import notebook_progress
from perfcap.pipeline.people import Scene
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.refine_people import Moving


def capture_scene(
    alone: Callable[..., Performance],
    scene: Scene,
    config: CaptureConfig | None = None,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
    **options: Any,
) -> tuple[Performance, ...]:
    """Capture everybody; one person as if there were no scene.

    Args:
        alone: captures one person: actor, cameras, detections, rate and settings.
        scene: with its people.
        config: settings.
        workers: threads of the stages that look at images; all cores when not given.
        progress: told of each person's stages, and of those of everybody.
        checkpoint: keeps each person's work, and everybody's.
        **options: of ``capture``.
    """
    if len(scene.people) == 1:
        (person,) = scene.people
        found = alone(
            person.actor, scene.cameras, person.detections, scene.rate, config,
            images=scene.images, solve_bones=person.solve_bones,
            workers=workers, progress=progress, checkpoint=checkpoint, **options,
        )  # fmt: skip
        return (found,)
    if options.get("level"):
        raise InputError("level: is for one person; several need calibrated views, in one world")
    tell = progress or notebook_progress() or (lambda stage, done, total: None)
    everybody = checkpoint or NO_CHECKPOINT
    moved = [
        move(
            person.actor, scene.cameras, person.detections, scene.rate, config,
            images=scene.images, solve_bones=person.solve_bones,
            progress=_numbered(number, tell), checkpoint=everybody.of(f"person{number}"),
            **options,
        )
        for number, person in enumerate(scene.people, 1)
    ]  # fmt: skip
    return _looked(scene, moved, tell, workers, everybody)


def _looked(
    scene: Scene,
    moved: list[Moved],
    tell: Progress,
    workers: int | None,
    checkpoint: Checkpoint,
) -> tuple[Performance, ...]:
    """What images add to the motions, where there are any."""
    until, images = moved[0].until, scene.images
    if images is None or not until.needs_images:
        return tuple(each.unlooked() for each in moved)
    people = [Moving(each.problem, each.motion, each.clock.stage, each.kept) for each in moved]
    configs = [each.start.config for each in moved]
    stage = partial(shared_stage, [each.clock for each in moved], tell)
    looked = look_at_people(people, images, configs, until, stage, workers, checkpoint)
    return tuple(each.performance(found) for each, found in zip(moved, looked, strict=True))


def _numbered(number: int, progress: Progress) -> Progress:
    return lambda stage, done, total: progress(f"person {number}: {stage}", done, total)
