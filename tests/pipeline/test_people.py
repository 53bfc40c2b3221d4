"""Several people in one scene: found, and captured one by one."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from crowds import RATE, make_crowd

import perfcap
from perfcap.detect.association import associate
from perfcap.errors import InputError
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.input_doubts import exchanged_actors
from perfcap.pipeline.performance import Performance

CROWD = make_crowd(2, frames=24, noise=2.0, spoil=0.2)
FOUND = associate(CROWD.cameras, CROWD.candidates, RATE)


def scene() -> perfcap.Scene:
    """Both, by whom they are."""
    owners, _ = CROWD.matched(FOUND.slots)
    people = tuple(
        perfcap.Person(CROWD.actors[k], person)
        for k, person in sorted(zip(owners, FOUND.people, strict=True), key=lambda pair: pair[0])
    )
    return perfcap.Scene(CROWD.cameras, people, RATE)


def same(one: Performance, other: Performance) -> bool:
    return all(
        torch.equal(getattr(one.motion, name), getattr(other.motion, name))
        for name in ("translation", "rotation", "angles")
    )


@pytest.mark.long
def test_one_person_is_a_tuple_of_one_with_the_same_bits() -> None:
    whole = scene()
    person = whole.people[0]
    (found,) = perfcap.capture(replace(whole, people=(person,)))
    alone = perfcap.capture(person.actor, CROWD.cameras, person.detections, RATE)
    assert same(found, alone) and found.warnings == alone.warnings
    assert [s.name for s in found.stages] == [s.name for s in alone.stages]


@pytest.mark.long
def test_everybody_is_where_they_were(tmp_path: Path) -> None:
    told: list[str] = []
    kept = Checkpoint(tmp_path)
    found = perfcap.capture(scene(), checkpoint=kept, progress=lambda stage, *_: told.append(stage))
    for k, each in enumerate(found):
        error = (each.joints() - CROWD.joints[k]).norm(dim=-1)
        assert 1000 * error.mean() < 15
    assert {line.split(":")[0] for line in told} == {"person 1", "person 2", "keep_apart"}
    names = {path.name.split("_")[0] for path in tmp_path.iterdir()}
    assert names == {"inputs.log", "person1", "person2"}
    again = perfcap.capture(scene(), checkpoint=kept)
    assert all(same(a, b) for a, b in zip(found, again, strict=True))


def test_a_scene_needs_people_who_fit() -> None:
    with pytest.raises(InputError, match="has nobody in it"):
        perfcap.Scene(CROWD.cameras, (), RATE)
    one, other = scene().people
    shorter = replace(other, detections=other.detections.frames(slice(5)))
    with pytest.raises(InputError, match="the same frames and views of everybody"):
        perfcap.Scene(CROWD.cameras, (one, shorter), RATE)


def test_several_people_have_one_world() -> None:
    with pytest.raises(InputError, match="level: is for one person"):
        perfcap.capture(scene(), level=True)  # type: ignore[call-overload]


def test_an_actor_needs_detections() -> None:
    with pytest.raises(TypeError, match="a scene, or an actor with cameras"):
        perfcap.capture(CROWD.actors[0])  # type: ignore[call-overload]


def test_a_scene_has_its_own_images_and_bone_lengths() -> None:
    for twice in ({"solve_bones": True}, {"images": object()}):
        with pytest.raises(InputError, match=f"got {next(iter(twice))} again: leave out"):
            perfcap.capture(scene(), **twice)  # type: ignore[call-overload]


def test_people_of_a_scene_are_any_iterable_of_persons() -> None:
    people = scene().people
    given = (each for each in people)
    assert replace(scene(), people=given).people == people  # type: ignore[arg-type]
    for wrong in (people[0].actor, 2):
        with pytest.raises(InputError, match=r"expected a (tuple of )?Person"):
            replace(scene(), people=wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="actor: got a Detections, expected Actor"):
        perfcap.Person(people[0].detections, people[0].actor)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"people\[0\] is a Actor, expected a Person"):
        replace(scene(), people=(people[0].actor,))  # type: ignore[arg-type]


# --- What is accepted, and said -------------------------------------------------------------------


def test_one_person_given_twice_is_refused() -> None:
    """As of two detectors: both were captured in one place, and then parted."""
    one, other = scene().people
    noise = torch.randn(one.detections.joints2d.shape, generator=torch.Generator().manual_seed(0))
    for again in (
        replace(one.detections, joints2d=one.detections.joints2d + 2 * noise),
        one.detections.to(torch.zeros(1)),
    ):
        with pytest.raises(InputError, match="people 0 and 1 have the same detections"):
            perfcap.Scene(CROWD.cameras, (one, replace(other, detections=again)), RATE)


def test_detections_of_people_have_one_type() -> None:
    """Where people touched, two types ended in a traceback."""
    one, other = scene().people
    rough = replace(other, detections=other.detections.to(torch.zeros(1)))
    mixed = perfcap.Scene(CROWD.cameras, (one, rough), RATE)
    assert {each.detections.joints2d.dtype for each in mixed.people} == {torch.float64}
    nowhere = replace(other, detections=other.detections.to(torch.zeros(1, device="meta")))
    with pytest.raises(InputError, match="lie on cpu and meta; expected one device"):
        perfcap.Scene(CROWD.cameras, (one, nowhere), RATE)


@pytest.mark.long
def test_exchanged_actors_and_seconds_of_a_frame_are_told() -> None:
    whole = scene()
    one, other = whole.people
    swapped = (replace(one, actor=other.actor), replace(other, actor=one.actor))
    until = perfcap.Stage.INITIALIZE
    for each in perfcap.capture(replace(whole, people=swapped, rate=1 / 30), until=until):
        told = "\n".join(each.warnings)
        assert "the actors of people 1 and 2 look exchanged: bones differ by" in told
        assert "rate is 0.03333 frames a second" in told and "give 30" in told
    solved = tuple(replace(each, solve_bones=True) for each in swapped)
    assert not any(exchanged_actors(replace(whole, people=solved)))
    assert not any(exchanged_actors(whole))
    notes = associate(CROWD.cameras, CROWD.candidates, 1 / RATE).notes
    assert any("frames a second" in note for note in notes)


def test_one_actor_for_people_of_other_sizes_is_told() -> None:
    """They were captured up to a tenth too large or too small, without a word."""
    whole = scene()
    one, other = whole.people
    bones = [each.actor.skeleton.rest_landmarks for each in (one, other)]
    assert not torch.equal(*bones)
    shared = (one, replace(other, actor=one.actor))
    told = exchanged_actors(replace(whole, people=shared))
    assert len(told) == 2
    for lines in told:
        assert "people 1 and 2 have one actor, but the bones of person" in "".join(lines)
    solved = tuple(replace(each, solve_bones=True) for each in shared)
    assert not any(exchanged_actors(replace(whole, people=solved)))


def test_actors_of_neither_are_not_said_to_be_exchanged() -> None:
    """Bodies that were fitted to each of them in three frames were: 13.2 % off, 12.2 exchanged."""
    whole = scene()
    groups = len(whole.people[0].actor.skeleton.group_names)
    odd = 0.15 * (-1.0) ** torch.arange(groups, dtype=torch.float64)
    one, other = (each.actor.resized(odd) for each in whole.people)
    ill = tuple(
        replace(each, actor=actor) for each, actor in zip(whole.people, (other, one), strict=True)
    )
    assert not any(exchanged_actors(replace(whole, people=ill)))
