"""``perfcap capture`` of several people: found in what was detected, then captured each."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch

from perfcap.actor.actor import Actor
from perfcap.app.auto_actor import Cast, cast
from perfcap.app.capture_checks import (
    doubts,
    made_up,
    places,
    refuse_wrong,
    refuse_wrong_cameras,
    sentences,
    wants_bones,
    way_doubts,
)
from perfcap.app.capture_request import casting_of, edge_network, find_device, settings_of
from perfcap.app.console import progress_bars
from perfcap.app.inputs import Inputs
from perfcap.app.match_people import UNMATCHED, Matching, match_actors
from perfcap.app.memory_budget import threads_within
from perfcap.app.people_files import CapturedScene, write_scene
from perfcap.app.said import all_said
from perfcap.commands.capture import AUTO, Capture
from perfcap.detect.association import Association, AssociationConfig, associate
from perfcap.errors import InputError
from perfcap.io.doctor.finding import Finding, doubting
from perfcap.io.mask_files import view_folders
from perfcap.io.result_folder import replacing, require_places
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.people import Person, Scene
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.stage import Stage

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Crowd:
    """People in the inputs of a capture.

    Attributes:
        inputs: with detections of everybody, (P, F, C, 16).
        found: who is who.
        generic: of each actor, whether it is nobody in particular.
        actors: those that were named, by their names.
    """

    inputs: Inputs
    found: Association
    generic: Sequence[bool]
    actors: Mapping[str, Actor]

    def of(self, track: int) -> Inputs:
        """What one person is captured from."""
        return replace(self.inputs, detections=self.found.people[track], warnings=())


def check_people(request: Capture) -> None:
    """Refuse numbers of actors and people that do not go together.

    Raises:
        InputError: says which.
    """
    actors, people = len(request.actor), request.people
    if not request.videos:
        raise InputError(
            "VIDEO: is missing; expected a video or a folder of images a view, before --actor, "
            "--detections and other options that take several values"
        )
    if not actors:
        raise InputError("--actor: is empty; expected auto, an actor, or one for each person")
    if isinstance(people, int) and people < 1:
        raise InputError(f"--people: is {people}; expected 1, 2, ..., or auto")
    if not request.everybody:
        return
    if actors > 1 and people not in (None, "auto", actors):
        raise InputError(
            f"--people: is {people} beside {actors} actors; expected one actor for everybody, or "
            "one each"
        )
    if actors > 1 and AUTO in request.actor:
        raise InputError(
            f"--actor: {AUTO} beside other actors; expected {AUTO} for everybody, or an actor each"
        )
    _require_views(request)
    options = {
        "lifter": request.lifter,
        "height": request.height,
        "masks": request.masks or None,
        "sync": request.sync if request.sync != "none" else None,
        "refine-cameras": request.refine_cameras or None,
    }
    for name, given in options.items():
        if given is not None:
            raise InputError(
                f"--{name}: is for one person; leave it out where several are captured"
            )


def _require_views(request: Capture) -> None:
    """One view shows one person; a video that follows ``--actor`` looks like another."""
    if len(request.videos) > 1:
        return
    if len(request.actor) > 1:
        raise InputError(
            f"--actor: names {', '.join(request.actor)}, one for each of several people, whom one "
            "view cannot tell apart; name one actor, and videos before --actor"
        )
    raise InputError(
        "--people: several people in one view cannot be told apart; expected two or more "
        "calibrated views"
    )


def find_people(
    request: Capture, inputs: Inputs, actors: Sequence[Actor], generic: Sequence[bool]
) -> Association:
    """Who is who: as many people as are asked for, or for several actors at least as many.

    Of one person with an actor of their own it is the one who has its bones.

    Args:
        request: for a capture of several, or of one of several.
        inputs: with detections of everybody.
        actors: those that are named.
        generic: of each actor that is asked for, whether it is nobody in particular.

    Raises:
        InputError: there are fewer, or cameras are wrong: in millimetres, say.
    """
    refuse_wrong_cameras(inputs.rig)
    parts = inputs.rig.cameras, inputs.detections, inputs.clip.fps
    config = AssociationConfig(resized=not request.detectors)
    who = partial(associate, *parts, config=config, names=inputs.rig.names)
    one = len(request.actor) == 1
    if one and (request.head_count != 1 or not actors or any(generic)):
        return who(people=request.head_count)
    wanted = len(request.actor)
    try:
        found = who()
    except InputError:
        found = None
    found = found if found and len(found.people) >= wanted else who(people=wanted)
    return _with_bones_of(actors[0], request.actor[0], found) if one else found


def _with_bones_of(actor: Actor, name: str, found: Association) -> Association:
    """The one of people who has the bones of an actor; of alike ones whom views see best."""
    others = len(found.people) - 1
    if not others:
        return found
    matching = match_actors([actor], found, [name])
    track = 0 if matching.notes else matching.tracks[0]
    own = slice(track, track + 1)
    who = "views see less of them" if matching.notes else f"{name} has other bones"
    note = f"further people: {others}, left out, since {who}"
    return Association(
        found.people[own],
        found.slots[own],
        found.joint_slots[own],
        found.points[own],
        found.margin[own],
        (*found.notes, *matching.notes, note),
    )


def run_people(
    request: Capture, folder: Path, crowd: Crowd, work: Checkpoint, said: Sequence[str]
) -> bool:
    """Capture everybody and write the folder, with what was printed; whether all went well."""
    started = time.perf_counter()
    matching, chosen = _cast(request, crowd, work)
    everybody = [crowd.of(track) for track in matching.tracks]
    for each in everybody:
        refuse_wrong(each)
    notes = [*crowd.inputs.warnings, *crowd.found.notes, *matching.notes, *_untold(crowd, matching)]
    until = Stage[request.until.upper()]
    more, found = _doubts(crowd.inputs, everybody, until.needs_images, bool(request.detectors))
    notes += more
    crowd.inputs.clip.keep(())
    for line in notes:
        _LOG.warning("%s", line)
    # said already, when the bodies were found
    notes += [f"person {k}: {line}" for k, one in enumerate(chosen, 1) for line in one.warnings]
    require_places(folder, view_folders(list(crowd.inputs.rig.names)))
    people = []
    for number, (one, each, wrong) in enumerate(zip(chosen, everybody, found, strict=True)):
        generic = crowd.generic[number % len(crowd.generic)]
        solve_bones = wants_bones(request.bones, generic, each.detections)
        people.append(Person(one.actor, doubting(each.detections, wrong), solve_bones))
    captured = _perform(request, crowd.inputs, people, until, work)
    pairs = zip(chosen, captured, strict=True)
    dressed = [one.dress(each, crowd.inputs) for one, each in pairs]
    done = [replace(each, lost=crowd.inputs.lost) for each in dressed]
    cast_of, told = tuple(chosen), all_said(said, *notes)
    scene = CapturedScene(tuple(done), cast_of, crowd.inputs, crowd.found, matching, told)
    with replacing(folder, last=True) as scratch:
        write_scene(request, scratch, scene, started, work)
    _tell(done, crowd.inputs.clip.start)
    return all(each.complete and each.trusted for each in done)


def _cast(request: Capture, crowd: Crowd, work: Checkpoint) -> tuple[Matching, list[Cast]]:
    """Who is whom, and the actor of each person."""
    count = len(crowd.found.people)
    if len(request.actor) > 1:
        actors = [crowd.actors[name] for name in request.actor]
        return match_actors(actors, crowd.found, request.actor), [Cast(each) for each in actors]
    found = []
    name = request.actor[0]
    casting = replace(casting_of(request, name), loaded=crowd.actors.get(name))
    with progress_bars() as tell:
        for track in range(count):
            kept = work.of(f"track{track + 1}")
            chosen = cast(casting, crowd.of(track), tell, kept)
            for line in chosen.warnings:
                _LOG.warning("person %d: %s", track + 1, line)
            found.append(chosen)
    return replace(UNMATCHED, tracks=tuple(range(count))), found


def _untold(crowd: Crowd, matching: Matching) -> list[str]:
    """People whom no actor plays."""
    others = len(crowd.found.people) - len(matching.tracks)
    if not others:
        return []
    return [f"{others} of {len(crowd.found.people)} people have no --actor; they are left out"]


def _doubts(
    inputs: Inputs, everybody: Sequence[Inputs], images: bool, detected: bool
) -> tuple[list[str], list[list[Finding]]]:
    """What may be wrong with the inputs; of one person, where it is not of all. And of each."""
    seen = {"detected": detected, "alone": False, "people": True}
    own = [
        doubts(each, needs_images=images, everybody=inputs.detections, **seen) for each in everybody
    ]
    lines = [sentences(each) for each in own]
    common = set(lines[0]).intersection(*lines[1:])
    of_all = [*way_doubts(inputs), *([] if detected else places(inputs))]
    found = [*sentences(of_all), *(line for line in lines[0] if line in common)]
    for number, some in enumerate(lines, 1):
        found += [f"person {number}: {line}" for line in some if line not in common]
    return found, own


def _perform(
    request: Capture,
    inputs: Inputs,
    people: Sequence[Person],
    until: Stage,
    work: Checkpoint,
) -> tuple[Performance, ...]:
    torch.set_num_threads(1)
    like = torch.zeros((), dtype=torch.float64, device=find_device(request.device))
    moved = tuple(replace(each, detections=each.detections.to(like)) for each in people)
    cameras = inputs.pixel_map.cameras(inputs.rig.cameras, inputs.clip.sizes)
    images = Images(inputs.clip, cameras, examined=True, edges=edge_network(request))
    scene = Scene(inputs.rig.cameras.to(like), moved, inputs.clip.fps, images)
    with progress_bars() as tell:
        config = settings_of(request)
        workers = threads_within(request.memory, inputs.clip.sizes, len(people))
        found = capture(
            scene, config=config, until=until, workers=workers, progress=tell, checkpoint=work
        )
    return tuple(each.to(like.cpu()) for each in found)


def _tell(people: Sequence[Performance], first: int) -> None:
    """Warnings of every person, with their number."""
    for number, each in enumerate(people, 1):
        untrusted = each.trust.sentences(first) if each.trust else ()
        for line in (*each.warnings, *made_up(each, first), *untrusted):
            _LOG.warning("person %d: %s", number, line)
