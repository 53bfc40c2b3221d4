"""Who is captured, and the scene that several people share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

import torch

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.pipeline.images import Images
from perfcap.pipeline.input_checks import require_flags, require_kinds
from perfcap.rates import frame_rate


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

    def __post_init__(self) -> None:
        require_kinds(actor=self.actor, detections=self.detections)
        require_flags(solve_bones=self.solve_bones)


@dataclass(frozen=True)
class Scene:
    """What several people share.

    Attributes:
        cameras: C views, (C,) or (F, C), in pixels of the detections.
        people: one or more, in any iterable.
        rate: frames a second.
        images: the frames that were detected in; None for joints alone.
    """

    cameras: Camera
    people: tuple[Person, ...]
    rate: float
    images: Images | None = None

    def __post_init__(self) -> None:
        require_kinds(cameras=self.cameras, images=self.images)
        object.__setattr__(self, "rate", frame_rate(self.rate))
        if not isinstance(self.people, Iterable):
            kind = type(self.people).__name__
            raise InputError(f"scene: people are a {kind}, expected a tuple of Person")
        object.__setattr__(self, "people", tuple(self.people))  # of a generator, and read often
        for number, each in enumerate(self.people):
            if not isinstance(each, Person):
                raise InputError(
                    f"scene: people[{number}] is a {type(each).__name__}, expected a Person: "
                    "Person(actor, detections)"
                )
        if not self.people:
            raise InputError("scene: has nobody in it; expected one person or more")
        shapes = {tuple(each.detections.confidence2d.shape) for each in self.people}
        if len(shapes) > 1:
            raise InputError(
                f"scene: detections of its people have shapes {sorted(shapes)}; expected the same "
                "frames and views of everybody"
            )
        for first, second in combinations(range(len(self.people)), 2):
            joints = [self.people[i].detections.joints2d for i in (first, second)]
            if joints[0] is joints[1] or torch.equal(*joints):
                raise InputError(
                    f"scene: people {first} and {second} have the same detections; expected those "
                    "of each, as associate finds them"
                )
