"""``--actor auto``: the body of the person in the videos, found before their motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from perfcap.actor.actor import Actor
from perfcap.app.fit_views import Evidence
from perfcap.app.inputs import Inputs
from perfcap.app.personal_body import BodyRequest, PersonalBody, find_body
from perfcap.commands.capture import AUTO
from perfcap.errors import InputError
from perfcap.io.actor import ActorFile, find_actor, load_actor, models_folder
from perfcap.io.body_model import DEFAULT_BODY
from perfcap.io.result_folder import BODY_PICTURE
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.painting import paint
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import PRESETS
from perfcap.rigging import Person, ViewFitSettings

BODY_SETTINGS = {"muvs2017": ViewFitSettings(consensus="median")}
"""How presets fit a body, where that differs from the default."""

_FRAMES, _LOOKED_AT = 24, 12  # that the body is fitted to, by joints alone and by silhouettes too
_NAME = "person"
_ONE_CAMERA = "one camera does not tell size from distance, --height sets it"


@dataclass(frozen=True)
class Casting:
    """Who is to be captured.

    Attributes:
        actor: a name, or ``auto``.
        height: of the person, metres, if known.
        masks: folders of silhouettes, one a view.
        look: whether images may be looked at: silhouettes are found in several views of them.
        preset: of the capture.
        alone: whether one person is captured, whose height can be given.
        loaded: the actor, where it was read before.
    """

    actor: str
    height: float | None = None
    masks: Sequence[Path] = ()
    look: bool = False
    preset: str = "default"
    alone: bool = True
    loaded: Actor | None = None

    def source(self) -> ActorFile:
        """The file that the actor is made from; the body model's for ``auto``.

        Raises:
            InputError: there is no such actor, or an option that does not belong to it.
        """
        if self.actor != AUTO:
            if self.height is not None:
                raise InputError(
                    f"--height: is for --actor {AUTO}; expected none with --actor {self.actor}, "
                    "which has a body of its own"
                )
            return find_actor(self.actor)
        if self.height is not None:
            Person(height=self.height)  # refuses what no person is
        return ActorFile(models_folder() / "bodies" / DEFAULT_BODY / "body.npz", generic=False)

    def body(self, views: int) -> BodyRequest:
        """What of the body is to be found in so many views."""
        seen = bool(self.masks) or (self.look and views > 1)
        count = _LOOKED_AT if seen else _FRAMES
        settings = BODY_SETTINGS.get(self.preset)
        edges = PRESETS[self.preset].contours.enabled and not self.masks
        shown: Evidence = "contours" if edges else "silhouettes"
        return BodyRequest(
            count=count,
            height=self.height,
            masks=self.masks,
            evidence=shown if seen else "joints",
            settings=settings,
        )


@dataclass(frozen=True)
class Cast:
    """The actor of a capture, what is known of a body found for it, and what a user should know."""

    actor: Actor
    warnings: tuple[str, ...] = ()
    body: PersonalBody | None = None

    def dress(self, performance: Performance, inputs: Inputs) -> Performance:
        """The same in the colours of the images, where a body was fitted and images looked at."""
        if self.body is None:
            return performance
        cameras = inputs.pixel_map.cameras(performance.cameras, inputs.clip.sizes)
        return paint(performance, inputs.clip, cameras)

    def save(self, folder: Path) -> None:
        """Write the files of the body, where there is one."""
        if self.body is not None:
            self.body.save(folder, BODY_PICTURE)


def cast(
    casting: Casting,
    inputs: Inputs,
    tell: Callable[[str, int, int], None],
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> Cast:
    """Load an actor by name, or fit the body model to the person.

    One view fits it to joints alone: clothes hide how thick somebody is. Several views whose
    images may be looked at, or masks, show that too: by silhouettes, or by the edges of the images
    where the preset has contours. The checkpoint keeps what was found there.

    Raises:
        InputError: the actor cannot be read, or nobody is detected.
    """
    if casting.actor != AUTO:
        return Cast(casting.loaded or load_actor(casting.actor))
    tell("body", 0, 1)
    body = find_body(inputs, casting.body(inputs.clip.views), checkpoint.of("body"))
    tell("body", 1, 1)
    template = replace(body.template, name=_NAME).rounded()
    found = body.fit.measurements
    note = f"--actor {AUTO}: a body {found.height:.2f} m tall was fitted to the {body.evidence}"
    more = body.doubts(alone=casting.alone)
    if casting.height is None and inputs.clip.views == 1:
        note, more = f"{note}; {_ONE_CAMERA}", ()
    actor = Actor(template).to(torch.zeros((), dtype=torch.float64))
    return Cast(actor, (note, *more), body)
