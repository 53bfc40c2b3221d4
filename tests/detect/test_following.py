"""Following with crops that turn, people who jump, and several networks, by a made-up network."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from made_up_eyes import SIDE, Eyes, Glance, draw, errors
from numpy.typing import NDArray

from perfcap.detect.decode import Estimate
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.person import Start, follow_person
from perfcap.detect.pose_fusion import TRUST
from perfcap.errors import InputError


@pytest.mark.parametrize("turns", ["quarters", "upright"])
@pytest.mark.parametrize("degrees", [90, 170, -100])
def test_somebody_who_lies_or_hangs_is_seen_upright(turns: str, degrees: float) -> None:
    frames = [draw((160 + f, 120, 130, degrees)) for f in range(3)]
    found = follow_person(Eyes(turns), iter(frames), Start())
    assert (found.confidence2d > 0.9).all()
    assert errors(found.joints2d[1, 0], 161, 120, 130, degrees).max() < 2
    without = follow_person(Eyes("none"), iter(frames), Start())
    assert (without.confidence2d < 0.5).all()


def test_the_next_person_and_the_one_in_a_box_can_be_chosen() -> None:
    frames = [draw((80, 120, 140, 0), (240, 130, 120, 0)) for _ in range(2)]
    places = [(80, 120, 140, 0), (240, 130, 120, 0)]
    starts = [Start(), Start(person=2), Start((180, 60, 300, 200))]
    for start, place in zip(starts, (places[0], places[1], places[1]), strict=True):
        found = follow_person(Eyes("none"), iter(frames), start)
        assert errors(found.joints2d[1, 0], *place).max() < 3


def test_others_who_are_seen_are_named_where_one_is_expected(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The surest of two was captured without a word, whoever was meant."""
    both, one = draw((80, 120, 140, 0), (240, 130, 120, 0)), draw((80, 120, 140, 0))
    cases = [(both, Start(alone=True)), (both, Start()), (one, Start(alone=True))]
    for (frame, start), told in zip(cases, (True, False, False), strict=True):
        caplog.clear()
        follow_person(Eyes("none"), iter([frame] * 3), start)
        words = [record.getMessage() for record in caplog.records]
        assert [each.startswith("2 people are seen") for each in words] == [True] * told
        assert not told or ("x 41 to 119" in words[0] and "--person 2" in words[0]), words


def test_a_box_around_nobody_is_refused() -> None:
    frames = [draw((80, 120, 140, 0)) for _ in range(2)]
    for box in ((200, 20, 300, 220), (100, 20, 300, 220)):  # the latter shows an arm
        with pytest.raises(InputError, match=r"--box .*: nobody is seen there"):
            follow_person(Eyes("none"), iter(frames), Start(box))


def test_whoever_shrinks_is_searched_for_and_found_where_they_are() -> None:
    """A poster where the person was takes over only if nobody else is nearer and surer."""
    frames = [draw((150, 120, 150, 0)), draw((190, 110, 150, 0), (148, 130, 60, 0))]
    found = follow_person(Eyes("none"), iter(frames), Start())
    assert errors(found.joints2d[1, 0], 190, 110, 150, 0).max() < 8  # the poster covers an arm


def test_a_passer_by_does_not_take_over_at_once() -> None:
    """Whoever is hidden is waited for; after some frames it may be anybody."""
    passing = draw((250, 130, 100, 0))
    frames = [draw((60, 120, 100, 0)), passing, draw((64, 120, 100, 0)), *[passing] * 10]
    found = follow_person(Eyes("none"), iter(frames), Start())
    seen = (found.confidence2d[:, 0] > 0).any(-1).tolist()
    assert seen[:4] == [True, False, True, False] and seen[-1]
    assert errors(found.joints2d[2, 0], 64, 120, 100, 0).max() < 3


@pytest.mark.long
def test_who_turns_up_elsewhere_is_doubted(caplog: pytest.LogCaptureFixture) -> None:
    """A jumper was lost, and a walker captured in their place, without a word."""
    here, gone, there = draw((60, 120, 100, 0)), draw(), draw((250, 130, 100, 0))
    for last, told in ((there, True), (draw((70, 120, 100, 0)), False)):
        caplog.clear()
        follow_person(Eyes("none"), iter([here, *[gone] * 9, last, last]), Start())
        words = [record.getMessage() for record in caplog.records]
        assert [w.startswith("frame 10: the person was not seen for 9") for w in words] == [
            True
        ] * told


def test_others_add_what_the_first_network_does_not_see() -> None:
    frames = [draw((150, 120, 150, 0)) for _ in range(2)]
    first = Eyes("none", blind=("l_toe", "r_toe"), surest=0.9)
    alone = follow_person(first, iter(frames), Start())
    toes = [LANDMARKS.index("l_toe"), LANDMARKS.index("r_toe")]
    assert (alone.confidence2d[..., toes] == 0).all()
    other = Eyes("upright", surest=0.5)
    both = follow_person(first, iter(frames), Start(), None, [other])
    assert other.crops == 2  # one a frame: it does not search
    torch.testing.assert_close(both.confidence2d[..., toes], torch.full((2, 1, 2), TRUST * 0.5))
    assert errors(both.joints2d[1, 0], 150, 120, 150, 0).max() < 2


@dataclass
class DeepEyes(Eyes):
    """Sees in 3D as well: joints in the plane of the image, with left and right as told."""

    swaps: bool = False

    def estimate(self, crops: NDArray[np.uint8]) -> Estimate:
        flat = super().estimate(crops)
        order = list(LANDMARKS16.mirrored()) if self.swaps else list(range(16))
        points = flat.joints2d[:, order]
        deep = torch.cat((points / SIDE, 0.1 * torch.arange(16.0)[order][None, :, None]), -1)
        return Estimate(points, flat.confidence[:, order], deep)


@pytest.mark.parametrize("swaps", [False, True])
def test_another_networks_poses_are_taken_where_they_are_of_use(swaps: bool) -> None:
    frames = [draw((150, 120, 150, 0)) for _ in range(2)]
    first, other = Eyes("none", surest=0.9), DeepEyes("none", surest=0.5, swaps=swaps)
    assert follow_person(first, iter(frames), Start(), None, [other]).joints3d is None
    found = follow_person(first, iter(frames), Start(), None, [other], poses=True)
    assert found.joints3d is not None and found.trusted3d.all()
    depth = 0.1 * torch.arange(16.0)
    expected = depth - depth[[8, 12]].mean()  # each joint its own, left and right as the first has
    torch.testing.assert_close(found.joints3d[..., 2], expected.expand(2, 1, 16))


def test_a_finder_saves_windows_and_finds_who_is_small() -> None:
    places = ((80, 120, 140), (250, 200, 50))
    frames = [draw(*((*place, 0) for place in places)) for _ in range(2)]
    windows, eyes = Eyes("none"), Eyes("none")
    follow_person(windows, iter(frames), Start())
    for person, place in enumerate(places, 1):
        eyes.crops = 0
        found = follow_person(eyes, iter(frames), Start(person=person, finder=Glance(places)))
        assert errors(found.joints2d[1, 0], *place, 0).max() < 3
        assert eyes.crops < windows.crops / 3


def test_windows_of_a_few_pixels_are_not_searched() -> None:
    looks = []
    for size in ((480, 640), (48, 64)):
        eyes = Eyes("none")
        empty = np.zeros((*size, 3), np.uint8)
        assert not follow_person(eyes, iter([empty]), Start()).confidence2d.any()
        looks.append(eyes.crops)
    assert looks[1] < looks[0] / 2


def test_windows_are_searched_where_a_finder_finds_too_few() -> None:
    place = (80, 120, 140)
    frames = [draw((*place, 0)), draw((*place, 0))]
    nothing, nowhere = Glance(()), Glance(((280, 60, 60),))
    for finder in (nothing, nowhere):
        found = follow_person(Eyes("none"), iter(frames), Start(finder=finder))
        assert errors(found.joints2d[1, 0], *place, 0).max() < 3
        assert finder.frames == 1, "who is followed is not searched for"
    both = [draw((*place, 0), (240, 130, 120, 0))] * 2
    found = follow_person(Eyes("none"), iter(both), Start(person=2, finder=Glance((place,))))
    assert errors(found.joints2d[1, 0], 240, 130, 120, 0).max() < 3


def test_a_box_says_which_of_a_finders_people() -> None:
    places = ((80, 120, 140), (250, 130, 100))
    frames = [draw(*((*place, 0) for place in places)) for _ in range(2)]
    box = (170, 20, 310, 230)  # about half of it is the person
    eyes, finder = Eyes("none"), Glance(places)
    found = follow_person(eyes, iter(frames), Start(box, finder=finder))
    assert errors(found.joints2d[1, 0], *places[1], 0).max() < 3
    with pytest.raises(InputError, match="nobody is seen there"):
        follow_person(eyes, iter(frames), Start((150, 10, 190, 90), finder=finder))


def test_who_jumps_is_looked_for_by_the_finder() -> None:
    here, there = (80, 120, 120), (170, 120, 120)
    frames = [draw((*place, 0)) for place in (here, here, there)]
    finder = Glance((here, there))
    found = follow_person(Eyes("none"), iter(frames), Start(finder=finder))
    assert finder.frames == 2
    assert errors(found.joints2d[2, 0], *there, 0).max() < 3
