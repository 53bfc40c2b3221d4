"""Several people, and the scene that they share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.images import Images

Result = TypeVar("Result")
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Person:
    """Somebody who is captured.

    Attributes:
        actor: the rigged person.
        detections: theirs alone, (F, C, 16), see ``associate``.
        solve_bones: find the person's bone lengths first; for an actor that is not the person.
    """

    actor: Actor
    detections: Detections
    solve_bones: bool = False


@dataclass(frozen=True)
class Scene:
    """What several people share.

    Attributes:
        cameras: C views, (C,) or (F, C), in pixels of the detections.
        people: one or more.
        rate: frames a second.
        images: the frames that were detected in; None for joints alone.
    """

    cameras: Camera
    people: tuple[Person, ...]
    rate: float
    images: Images | None = None

    def __post_init__(self) -> None:
        if not self.people:
            raise InputError("scene: has nobody in it; expected one person or more")
        shapes = {tuple(each.detections.confidence2d.shape) for each in self.people}
        if len(shapes) > 1:
            raise InputError(
                f"scene: detections of its people have shapes {sorted(shapes)}; expected the same "
                "frames and views of everybody"
            )


def one_by_one(
    capture: Callable[..., Result],
    scene: Scene,
    config: Any = None,
    *,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
    **options: Any,
) -> tuple[Result, ...]:
    """Capture everybody on their own; one person as if there were no scene.

    Args:
        capture: of one person: actor, cameras, detections, rate and settings.
        scene: with its people.
        config: settings.
        progress: told of each person's stages.
        checkpoint: keeps each person's work.
        **options: of ``capture``.
    """
    if len(scene.people) > 1 and options.get("level"):
        raise InputError("level: is for one person; several need calibrated views, in one world")
    found = []
    for number, person in enumerate(scene.people, 1):
        tell, kept = progress, checkpoint
        if len(scene.people) > 1:
            tell = None if progress is None else _numbered(number, progress)
            kept = None if checkpoint is None else checkpoint.of(f"person{number}")
        found.append(
            capture(
                person.actor, scene.cameras, person.detections, scene.rate, config,
                images=scene.images, solve_bones=person.solve_bones,
                progress=tell, checkpoint=kept, **options,
            )
        )  # fmt: skip
    return tuple(found)


def _numbered(number: int, progress: Progress) -> Progress:
    return lambda stage, done, total: progress(f"person {number}: {stage}", done, total)
