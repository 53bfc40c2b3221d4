"""Several people followed in one view, each by one track, by made-up networks."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from made_up_eyes import PLACES, SIDE, Eyes, Glance, draw, errors
from numpy.typing import NDArray

from perfcap.detect.crop import Crop
from perfcap.detect.crowd import same_person
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import COCO17, LANDMARKS16
from perfcap.detect.look import Look
from perfcap.detect.person import follow_people
from perfcap.detect.search import whole
from perfcap.detect.whereabouts import AGE, ANYWHERE

Place = tuple[float, float, float]
LEFT, RIGHT = (80, 120, 120), (240, 130, 100)


def frame(*places: Place) -> NDArray[np.uint8]:
    return draw(*((*place, 0) for place in places))


class Watching(Glance):
    """Sees who is there in each frame: (number of the frame, people), in order."""

    def __init__(self, people: list[tuple[Place, ...]]) -> None:
        super().__init__(())
        self.all, self.asked = people, list[int]()

    def at(self, number: int) -> NDArray[np.uint8]:
        self.number = number
        return frame(*self.all[number])

    def __call__(self, frame: NDArray[np.uint8]) -> list[Look]:
        self.asked.append(self.number)
        self.people = self.all[self.number]
        return super().__call__(frame)


def follow(
    people: list[tuple[Place, ...]], count: int, others: tuple[Eyes, ...] = ()
) -> tuple[tuple[Detections, ...], Watching]:
    finder = Watching(people)
    frames = (finder.at(number) for number in range(len(people)))
    return follow_people(Eyes("none"), frames, finder, count, others=others), finder


def off(found: Detections, number: int, place: Place) -> float:
    return float(errors(found.joints2d[number, 0], *place, 0).max())


def test_each_person_is_followed_once_and_looked_for_once() -> None:
    steps = [((80 + 2 * f, 120, 120), (240 - 2 * f, 130, 100)) for f in range(5)]
    (left, right), finder = follow(steps, 2)
    for number, (one, other) in enumerate(steps):
        assert off(left, number, one) < 3 and off(right, number, other) < 3
    assert finder.asked == [0]
    (alone, nobody), finder = follow([(LEFT,)] * 3, 2)
    assert off(alone, 2, LEFT) < 3
    assert (nobody.confidence2d == 0).all()
    assert finder.asked == [0, 1, 2], "a track is free"


def test_the_first_person_of_many_is_the_surest() -> None:
    (found,), finder = follow([(LEFT, RIGHT)] * 2, 1)
    assert off(found, 1, LEFT) < 3 and finder.asked == [0]


def test_a_person_behind_another_is_as_the_finder_saw_them() -> None:
    """The network that looks up close sees the surer person only, in both crops."""
    front = (150, 120, 130)
    steps = [(front, (150 + 25 + 8 * abs(f - 4), 110, 110)) for f in range(9)]
    for others in ((), (Eyes("none"),)):
        (first, second), finder = follow(steps, 2, others)
        for number, (one, other) in enumerate(steps):
            assert errors(first.joints2d[number, 0], *one, 0).median() < 3  # some are hidden
            assert off(second, number, other) < 0.12 * 110, "not the person in front"
        assert 0 < len(finder.asked) - 1 < len(steps)


def test_who_is_lost_comes_back_to_the_same_track() -> None:
    both, alone, passing = (LEFT, RIGHT), (LEFT,), (LEFT, (160, 40, 50))
    (first, second), _ = follow([both, alone, passing, both], 2)
    assert all(off(first, number, LEFT) < 3 for number in range(4))
    seen = (second.confidence2d[:, 0] > 0).any(-1).tolist()
    assert seen == [True, False, False, True], "whoever passes far away is another person"
    assert off(second, 3, RIGHT) < 3
    (_, second), _ = follow([both, *[passing] * 10], 2)
    assert off(second, 10, passing[1]) < 3, "after some frames it may be anybody"


def test_who_jumps_changes_places_with_nobody() -> None:
    steps = [(LEFT, RIGHT), ((80, 120, 120), (200, 130, 100)), ((80, 120, 120), (170, 130, 100))]
    (first, second), _ = follow(steps, 2)
    for number, (one, other) in enumerate(steps):
        assert off(first, number, one) < 3 and off(second, number, other) < 3


def a_look(x: float, y: float, height: float) -> Look:
    points = height * (PLACES - torch.tensor([0.0, 0.5])) + torch.tensor([x, y])
    crop = Crop.around(whole(frame()), (SIDE, SIDE))
    return Look(crop, points, torch.ones(16), None, None)


@pytest.mark.parametrize(
    ("place", "same"), [((104, 122, 98), True), ((125, 120, 100), False), ((100, 150, 100), False)]
)
def test_the_same_person_is_where_the_joints_are(place: Place, same: bool) -> None:
    one, other = a_look(100, 120, 100), a_look(*place)
    assert same_person(one, other, LANDMARKS16) is same
    order = list(LANDMARKS16.mirrored())
    exchanged = replace(one, joints2d=one.joints2d[order])
    assert same_person(exchanged, other, LANDMARKS16) is same
    unseen = replace(one, confidence=torch.zeros(16))
    assert not same_person(unseen, other, LANDMARKS16)


def test_looks_of_two_sets_are_compared_by_their_names() -> None:
    one = a_look(100, 120, 100)
    names = {name: place for name, place in zip(LANDMARKS16.joints, one.joints2d, strict=True)}
    points = torch.stack([names.get(name, torch.zeros(2)) for name in COCO17.joints])
    seen = torch.tensor([float(name in names) for name in COCO17.joints])
    other = replace(one, joints2d=points, confidence=seen)
    assert same_person(other, one, LANDMARKS16, COCO17)


def test_the_likelier_look_is_the_surer_and_the_nearer_one() -> None:
    known = ANYWHERE.after(a_look(100, 120, 100))
    there, beside, far = (a_look(x, 120, 100) for x in (100, 140, 230))
    assert known.likely(there, LANDMARKS16) == pytest.approx(1)
    assert 0.5 < known.likely(beside, LANDMARKS16) < 0.75  # 40 pixels of some 116
    assert known.near(beside) and not known.near(far)
    empty = replace(there, confidence=torch.full((16,), 0.2))
    assert known.likely(empty, LANDMARKS16) == pytest.approx(0.2 - 1), "no body to compare"
    for _ in range(AGE):
        known = known.after(None)
    assert known.near(far), "anywhere by now"
    assert known.likely(far, LANDMARKS16) == pytest.approx(1)
