"""Who is captured, and the scene that several people share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations

import torch

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.pipeline.clip_notes import clip_notes
from perfcap.pipeline.images import Images
from perfcap.pipeline.input_checks import require_flags, require_kinds
from perfcap.rates import frame_rate

_SAME = 0.05  # of a person's height in every view: nobody else stands so near all the time


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
        rate: frames a second, or the clip that has them.
        images: the frames that were detected in; None for joints alone.
        notes: what a user should know of all that was read; what a clip says is added.
    """

    cameras: Camera
    people: tuple[Person, ...]
    rate: float
    images: Images | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_kinds(cameras=self.cameras, images=self.images)
        rate = frame_rate(self.rate)
        reader = None if self.images is None or self.images.examined else self.images.reader
        told = (*self.notes, *clip_notes(self.rate, rate), *clip_notes(reader, rate))
        object.__setattr__(self, "notes", tuple(dict.fromkeys(told)))
        object.__setattr__(self, "rate", rate)
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
        if self.images is not None and self.images.masks is not None and len(self.people) > 1:
            raise InputError(
                f"scene: images have masks, which are of one person, and there are "
                f"{len(self.people)}; leave masks out, everybody's are found"
            )
        shapes = {tuple(each.detections.confidence2d.shape) for each in self.people}
        if len(shapes) > 1:
            raise InputError(
                f"scene: detections of its people have shapes {sorted(shapes)}; expected the same "
                "frames and views of everybody"
            )
        object.__setattr__(self, "people", _alike(self.people))
        for first, second in combinations(range(len(self.people)), 2):
            if _same(*(self.people[i].detections for i in (first, second))):
                raise InputError(
                    f"scene: people {first} and {second} have the same detections; expected those "
                    "of each, as associate finds them"
                )


def _alike(people: tuple[Person, ...]) -> tuple[Person, ...]:
    """The same people with detections of one type, the most precise of theirs."""
    places = {str(each.detections.joints2d.device) for each in people}
    if len(places) > 1:
        raise InputError(
            f"scene: detections of its people lie on {' and '.join(sorted(places))}; expected one "
            "device: take them there by detections.to(torch.zeros(1, device=...))"
        )
    types = [each.detections.joints2d.dtype for each in people]
    if len(set(types)) == 1 or not all(each.is_floating_point for each in types):
        return people
    like = people[0].detections.joints2d.new_zeros((), dtype=reduce(torch.promote_types, types))
    return tuple(replace(each, detections=each.detections.to(like)) for each in people)


def _same(one: Detections, other: Detections) -> bool:
    """Whether two people are the same one: at the same place in every view that shows both."""
    if one.joints2d is other.joints2d or torch.equal(one.joints2d, other.joints2d):
        return True
    if one.joints2d.dim() != 4 or not one.frame_count:
        return False  # refused where they are captured
    one, other = (each.map(torch.Tensor.detach).finite() for each in (one, other))
    both = (one.confidence2d > 0) & (other.confidence2d > 0)
    apart = (one.joints2d - other.joints2d).norm(dim=-1) / one.person_height()[:, None]
    usual = apart.where(both, torch.nan).transpose(0, 1).flatten(1).nanmedian(1).values  # C
    known = usual[usual.isfinite()]
    return bool(len(known)) and bool((known < _SAME).all())
