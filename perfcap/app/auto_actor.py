"""``--actor auto``: the shipped body model with the bones of the person in the video."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch

from perfcap.actor.actor import Actor
from perfcap.app.fit_views import choose_frames, fit_person
from perfcap.app.inputs import Inputs
from perfcap.errors import InputError
from perfcap.io.actor import ActorFile, find_actor, load_actor, models_folder
from perfcap.io.body_model import DEFAULT_BODY, load_body_model
from perfcap.rigging import Person

AUTO = "auto"

_FRAMES = 24  # that the body is fitted to
_NAME = "person"


@dataclass(frozen=True)
class Cast:
    """The actor of a capture, and what a user should know about it."""

    actor: Actor
    warnings: tuple[str, ...] = ()


def find_source(name: str, height: float | None) -> ActorFile:
    """The file that an actor is made from; the body model's for ``auto``.

    Raises:
        InputError: there is no such actor, or a height that does not belong to it.
    """
    if name != AUTO:
        if height is not None:
            raise InputError(
                f"--height: is for --actor {AUTO}; expected none with --actor {name}, which has "
                "its own"
            )
        return find_actor(name)
    if height is not None:
        Person(height=height)  # refuses what no person is
    return ActorFile(models_folder() / "bodies" / DEFAULT_BODY / "body.npz", generic=False)


def cast(
    name: str, height: float | None, inputs: Inputs, tell: Callable[[str, int, int], None]
) -> Cast:
    """Load an actor by name, or fit the body model to the joints of the video.

    Shapes are of joints alone: clothes hide how thick somebody is.

    Raises:
        InputError: the actor cannot be read, or nobody is detected.
    """
    if name != AUTO:
        return Cast(load_actor(name))
    tell("body", 0, 1)
    chosen = choose_frames(inputs, _FRAMES)
    fit, _ = fit_person(load_body_model(DEFAULT_BODY), chosen, height, segment=False)
    tell("body", 1, 1)
    template = replace(fit.template, name=_NAME).rounded()
    tall = fit.measurements.height
    note = f"--actor {AUTO}: a body {tall:.2f} m tall was fitted to the joints"
    if height is None and inputs.clip.views == 1:
        note += "; one camera does not tell size from distance, --height sets it"
    return Cast(Actor(template).to(torch.zeros((), dtype=torch.float64)), (note,))
