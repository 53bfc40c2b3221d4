"""One person followed among others, by made-up networks: nobody takes their place."""

import numpy as np
import torch
from made_up_eyes import Eyes, Glance, draw, errors
from numpy.typing import NDArray

from perfcap.detect.detections import Detections
from perfcap.detect.look import Look
from perfcap.detect.person import Start, follow_person
from perfcap.detect.whereabouts import AGE

Place = tuple[float, float, float]
PERSON: Place = (230, 120, 110)
PASSING: list[Place] = [(40 + 12 * f, 118, 130) for f in range(21)]
HIDDEN = 24  # pixels between two people: the one behind is not seen


class Watcher(Glance):
    """Sees those of each frame who are not hidden; counts how often it is asked."""

    def __init__(self, shown: list[tuple[Place, ...]]) -> None:
        super().__init__(())
        self.shown, self.number = shown, -1

    def __call__(self, frame: NDArray[np.uint8]) -> list[Look]:
        self.people = self.shown[self.number]
        return super().__call__(frame)


def follow(
    steps: list[tuple[Place, ...]],
    shown: list[tuple[Place, ...]] | None = None,
    box: tuple[float, float, float, float] | None = (170, 50, 290, 190),
    others: tuple[Eyes, ...] = (),
    told_apart: bool = True,
) -> tuple[Detections, Watcher]:
    """Follow whom the box says; the first of each frame is the surest, and covers the others."""
    watcher = Watcher(shown or steps)

    def frames() -> list[NDArray[np.uint8]]:
        for number, people in enumerate(steps):
            watcher.number = number
            yield draw(*((*place, 0) for place in people))

    start = Start(box, watcher=watcher if told_apart else None)
    return follow_person(Eyes("none"), frames(), start, None, others), watcher


def off(found: Detections, number: int, place: Place) -> float:
    """Median error in a frame; infinite where nobody is found."""
    if not (found.confidence2d[number] > 0.2).any():
        return float("inf")
    return float(errors(found.joints2d[number, 0], *place, 0).median())


def passed() -> tuple[list[tuple[Place, ...]], list[tuple[Place, ...]]]:
    """Somebody who passes in front, and whom the watcher sees."""
    steps = [(other, PERSON) for other in PASSING]
    shown = [each if abs(each[0][0] - PERSON[0]) >= HIDDEN else each[:1] for each in steps]
    return steps, shown


def test_who_passes_in_front_does_not_take_over() -> None:
    steps, shown = passed()
    found, _ = follow(steps, shown)
    for number, people in enumerate(shown):
        if len(people) == 2:
            assert off(found, number, PERSON) < 0.1 * 110
        else:
            assert off(found, number, people[0]) > 0.1 * 110, "hidden, or where they are"
    without, _ = follow(steps, shown, told_apart=False)
    last = len(steps) - 1
    assert off(without, last, PASSING[last]) < 3, "what the watcher is for"


def test_other_networks_look_at_nobody_else() -> None:
    steps, shown = passed()
    found, _ = follow(steps, shown, others=(Eyes("none"),))
    for number, people in enumerate(shown):
        if len(people) == 2:
            assert off(found, number, PERSON) < 0.1 * 110


def test_one_person_alone_is_followed_as_ever_and_looked_after_now_and_then() -> None:
    steps: list[tuple[Place, ...]] = [((100 + 4 * f, 120, 110),) for f in range(21)]
    box = (40.0, 50.0, 160.0, 190.0)
    found, watcher = follow(steps, box=box)
    without, unasked = follow(steps, box=box, told_apart=False)
    assert torch.equal(found.joints2d, without.joints2d)
    assert torch.equal(found.confidence2d, without.confidence2d)
    # the box in the first frame is one more
    assert (watcher.frames, unasked.frames) == (1 + 3, 0)


def test_the_box_says_whom_to_follow_of_two_who_overlap() -> None:
    front, behind = (130.0, 118.0, 130.0), (158.0, 120.0, 110.0)
    steps: list[tuple[Place, ...]] = [(front, behind)] * 3
    box = (128.0, 60.0, 190.0, 182.0)
    found, _ = follow(steps, box=box)
    without, _ = follow(steps, box=box, told_apart=False)
    for number in range(3):
        assert off(found, number, behind) < 0.1 * 110
        assert off(without, number, behind) > 0.1 * 110


def test_who_was_hidden_for_long_comes_back_and_is_no_one_else() -> None:
    """Whoever was seen beside the person is somebody else, however long the person is away."""
    beside, gone = (100.0, 118.0, 130.0), 2 * AGE
    both: list[tuple[Place, ...]] = [(beside, PERSON)] * 4
    back = (245.0, 120.0, 110.0)
    steps = [*both, *[(beside,)] * gone, *[(beside, back)] * 3]
    found, _ = follow(steps)
    seen = (found.confidence2d[:, 0] > 0.2).any(-1).tolist()
    assert seen == [True] * 4 + [False] * gone + [True] * 3
    assert off(found, len(steps) - 1, back) < 0.1 * 110


def test_who_was_overlooked_for_a_moment_is_still_the_person() -> None:
    """They jump aside as nobody sees them, and turn up as somebody new."""
    beside, there = (60.0, 118.0, 130.0), (148.0, 120.0, 110.0)
    steps = [*[(beside, PERSON)] * 4, *[(beside,)] * 2, *[(beside, there)] * 14]
    found, _ = follow(steps)
    assert off(found, len(steps) - 1, there) < 0.1 * 110


def test_who_walked_off_while_the_person_is_hidden_is_no_one_else() -> None:
    person, away = (60.0, 120.0, 50.0), 2 * AGE
    beside = [(100.0 + 12 * f, 120.0, 56.0) for f in range(away)]
    steps: list[tuple[Place, ...]] = [(beside[0], person)] * 4
    steps += [(each,) for each in beside]
    found, _ = follow(steps, box=(30, 88, 86, 152))
    seen = (found.confidence2d[:, 0] > 0.2).any(-1).tolist()
    assert seen == [True] * 4 + [False] * away


def test_who_left_long_ago_is_forgotten() -> None:
    steps: list[tuple[Place, ...]] = [((100, 118, 130), PERSON)] * 3 + [(PERSON,)] * 60
    found, watcher = follow(steps)
    assert all(off(found, number, PERSON) < 0.1 * 110 for number in range(len(steps)))
    assert watcher.frames < 45, "once in ten frames again"


def test_who_turns_up_close_by_between_two_looks_around_does_not_take_over() -> None:
    """Where the person seems to jump, it is seen at once who else is there."""
    sudden = (182.0, 120.0, 112.0)
    steps: list[tuple[Place, ...]] = [*[(PERSON,)] * 4, *[(sudden, PERSON)] * 5]
    found, watcher = follow(steps)
    assert all(off(found, number, PERSON) < 0.1 * 110 for number in range(len(steps)))
    assert watcher.frames == 1 + 1 + 5
    without, _ = follow(steps, told_apart=False)
    assert off(without, 6, sudden) < 3


def test_who_was_hidden_for_long_may_come_back_far_away_in_another_light() -> None:
    person, beside, back = (60.0, 120.0, 50.0), (110.0, 120.0, 56.0), (250.0, 120.0, 80.0)
    steps: list[tuple[Place, ...]] = [(beside, person)] * 4
    steps += [*[(beside,)] * (2 * AGE), *[(beside, back)] * 3]
    found, _ = follow(steps, box=(30, 88, 86, 152))
    assert off(found, len(steps) - 1, back) < 0.1 * 80
