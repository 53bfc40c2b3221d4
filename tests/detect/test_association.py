"""Several people in several views: who is who."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from crowds import RATE, Crowd, make_crowd, without_owner

from perfcap.detect.association import Association, AssociationConfig, associate, tracked_bones
from perfcap.detect.association.grouping import group_views
from perfcap.detect.association.sightings import Sightings
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.errors import InputError


def check(crowd: Crowd, found: Association, least: float = 1.0) -> None:
    """Nobody has another's detection, and of those that are right everybody has theirs."""
    people, who = crowd.matched(found.slots)
    assert len(set(people)) == len(people) == len(crowd.actors)
    for k, person in enumerate(people):
        mistaken = (who[k] != person) & (who[k] != -2)
        assert not mistaken.any(), (person, np.argwhere(mistaken)[:3])
        own = ((crowd.owner == person) & crowd.right).any(0)
        got = (who[k] == person) & own
        assert got.sum() >= least * own.sum(), (person, np.argwhere(own & ~got)[:5])


@pytest.mark.long
@pytest.mark.parametrize("views", [2, 3, 5])
@pytest.mark.parametrize("count", [2, 3])
def test_shuffled_people_are_put_together(count: int, views: int) -> None:
    crowd = make_crowd(1, count=count, views=views)
    found = associate(crowd.cameras, crowd.candidates, RATE)
    check(crowd, found)
    assert found.notes == () and len(found.people) == count
    for k, person in enumerate(crowd.matched(found.slots)[0]):
        apart = (found.points[k] - crowd.joints[person]).norm(dim=-1)
        assert apart.nanmedian() < 0.03


@pytest.mark.long
@pytest.mark.parametrize("seed", range(12))
def test_identity_survives_planted_mistakes(seed: int) -> None:
    """Where two views are right, whatever the others say."""
    crowd = make_crowd(seed, count=2 + seed % 2, views=4 + seed % 2, spoil=0.3)
    assert not crowd.right.all()
    check(crowd, associate(crowd.cameras, crowd.candidates, RATE), least=0.995)


@pytest.mark.long
def test_order_of_slots_does_not_matter() -> None:
    crowd = make_crowd(3, spoil=0.2)
    one = associate(crowd.cameras, crowd.candidates, RATE)
    turned = crowd.candidates.map(lambda each: each.flip(0))
    other = associate(crowd.cameras, turned, RATE)
    for a, b in zip(one.people, other.people, strict=True):
        assert torch.equal(a.joints2d, b.joints2d) and torch.equal(a.confidence2d, b.confidence2d)


@pytest.mark.long
def test_people_are_what_their_slots_hold() -> None:
    crowd = make_crowd(2, spoil=0.2)
    found = associate(crowd.cameras, crowd.candidates, RATE)
    for person, slots in zip(found.people, found.slots, strict=True):
        for frame, view in np.argwhere(slots.numpy() >= 0):
            taken = crowd.candidates.joints2d[slots[frame, view], frame, view]
            assert (person.joints2d[frame, view] == taken).all(-1).sum() >= 9  # one limb may not be
        assert (person.confidence2d[slots < 0] == 0).all()


@pytest.mark.long
@pytest.mark.parametrize("views", [2, 4])
def test_limbs_come_back(views: int) -> None:
    """Arms and legs that are exchanged, or listed of both, for a few frames in one view."""
    crowd = make_crowd(11, frames=30, views=views)
    joints, owner = crowd.candidates.joints2d.clone(), crowd.owner
    planted = torch.zeros(2, 30, views, 16, dtype=torch.bool)
    for frame, view in ((5, 0), (6, 0), (15, 1), (16, 1), (25, 0)):
        limb = slice(5, 8) if view else slice(8, 12)
        joints[:, frame, view, limb] = joints[:, frame, view, limb].flip(0)
        planted[:, frame, view, limb] = True
    merged = (10, 0)
    one = int(np.flatnonzero(owner[:, *merged] == 0)[0])
    joints[1 - one, *merged, 12:16] = joints[one, *merged, 12:16]
    found = associate(crowd.cameras, replace(crowd.candidates, joints2d=joints), RATE)
    people, _ = crowd.matched(found.slots)
    pixels = crowd.cameras.project(crowd.joints)
    for k, person in enumerate(people):
        seen = found.people[k]
        off = (seen.joints2d - pixels[person]).norm(dim=-1)
        assert (off[planted[0]] < 25).all()
        assert (off[seen.confidence2d > 0] < 25).all()
        dropped = (seen.confidence2d == 0).sum()
        assert dropped == (4 if person == 1 else 0)


@pytest.mark.long
def test_a_stranger_in_one_view_is_left_out() -> None:
    crowd = make_crowd(4, stranger=True)
    found = associate(crowd.cameras, crowd.candidates, RATE)
    check(crowd, found)
    assert any("view 0" in note and "no other view" in note for note in found.notes)


@pytest.mark.long
def test_a_blind_view_is_no_trouble() -> None:
    crowd = without_owner(make_crowd(5), view=1)
    found = associate(crowd.cameras, crowd.candidates, RATE)
    check(crowd, found)
    assert all((each.confidence2d[:, 1] == 0).all() for each in found.people)


@pytest.mark.long
def test_a_candidate_listed_twice_counts_once() -> None:
    crowd = make_crowd(6)
    doubled = crowd.candidates.map(lambda each: torch.cat((each, each)))
    twice = replace(
        crowd,
        candidates=doubled,
        owner=np.concatenate((crowd.owner, crowd.owner)),
        right=np.concatenate((crowd.right, crowd.right)),
    )
    found = associate(twice.cameras, doubled, RATE)
    check(twice, found)
    assert found.notes == ()


@pytest.mark.long
def test_somebody_comes_back() -> None:
    """Known again by bone lengths, although unseen for longer than places are remembered."""
    crowd = make_crowd(7, frames=120, away=[slice(0), slice(40, 85)])
    found = associate(crowd.cameras, crowd.candidates, RATE)
    check(crowd, found)
    assert any("known again by bone lengths" in note for note in found.notes)


@pytest.mark.long
def test_people_who_come_later_are_somebody_else() -> None:
    """The one who comes has other bones than the one who has left."""
    crowd = make_crowd(8, count=3, frames=160, away=[slice(0), slice(70, 160), slice(0, 115)])
    found = associate(crowd.cameras, crowd.candidates, RATE)
    check(crowd, found)
    assert sorted(crowd.matched(found.slots)[0]) == [0, 1, 2]
    assert not any("known again" in note for note in found.notes)


@pytest.mark.long
def test_the_best_seen_are_kept_of_more_than_are_wanted() -> None:
    crowd = make_crowd(9, count=3, away=[slice(0), slice(0), slice(15, 40)])
    found = associate(crowd.cameras, crowd.candidates, RATE, people=2)
    assert sorted(crowd.matched(found.slots)[0]) == [0, 1]
    assert any("further people" in note for note in found.notes)
    assert not any("no other view confirms" in note for note in found.notes)


@pytest.mark.long
def test_fewer_people_than_are_wanted() -> None:
    crowd = make_crowd(0)
    with pytest.raises(InputError, match="3 are wanted, 2 are seen"):
        associate(crowd.cameras, crowd.candidates, RATE, people=3)


@pytest.mark.long
@pytest.mark.parametrize("views", [2, 3, 5])
def test_exchanged_views_are_named(views: int) -> None:
    crowd = make_crowd(1, views=views)
    order = [views - 1, *range(1, views - 1), 0]
    mixed = crowd.candidates.select(order)
    words = f"views 0 and {views - 1}, counted from 0, look exchanged"
    try:
        notes = associate(crowd.cameras, mixed, RATE, people=2).notes
    except InputError as error:
        notes = (str(error),)
    assert any(words in note for note in notes)


@pytest.mark.long
@pytest.mark.parametrize("view", [0, 2])
def test_sides_that_are_swapped_in_a_view_are_named(view: int) -> None:
    crowd = make_crowd(1, views=3)
    other = list(LANDMARKS16.mirrored())
    joints = crowd.candidates.joints2d.clone()
    joints[:, :, view] = joints[:, :, view, other]
    mixed = replace(crowd.candidates, joints2d=joints)
    notes = associate(crowd.cameras, mixed, RATE).notes
    assert notes[0].startswith(f"left and right joints look swapped in view {view} (counted")


@pytest.mark.long
@pytest.mark.parametrize(
    ("scale", "size"), [(0.5, "half"), (2 / 3, "two thirds of"), (2.0, "twice")]
)
@pytest.mark.parametrize("count", [1, 2])
def test_pixels_of_another_size_are_named(count: int, scale: float, size: str) -> None:
    """Half of them had four people in place of two, without a note."""
    crowd = make_crowd(1, count=count, views=3)
    other = replace(crowd.candidates, joints2d=scale * crowd.candidates.joints2d)
    try:
        notes = associate(crowd.cameras, other, RATE).notes
    except InputError as error:
        notes = (str(error),)
    assert any(f"in pixels of videos of {size} the size" in note for note in notes)


def test_clips_of_a_frame_or_two_are_refused() -> None:
    crowd = make_crowd(1)
    with pytest.raises(InputError, match="the clip has 2 frames; expected 3 or more"):
        associate(crowd.cameras, crowd.candidates.frames(slice(0, 2)), RATE, people=2)


def test_kinds_and_shapes_that_are_others() -> None:
    crowd = make_crowd(1, views=3)
    with pytest.raises(InputError, match=r"candidates have joints2d \(.*for cameras of 2 views"):
        associate(crowd.cameras.select([0, 1]), crowd.candidates, RATE)
    with pytest.raises(InputError, match="people, who may be in any order, first"):
        associate(crowd.cameras, crowd.candidates.map(lambda part: part[0]), RATE)
    with pytest.raises(InputError, match="cameras and candidates are tuple and Detections"):
        associate((crowd.cameras,), crowd.candidates, RATE)  # type: ignore[arg-type]


def test_one_view_is_refused() -> None:
    crowd = make_crowd(0)
    with pytest.raises(InputError, match="one view cannot tell who is who"):
        associate(crowd.cameras.select([0]), crowd.candidates.select([0]), RATE)


def test_views_of_different_people_are_refused() -> None:
    crowd = make_crowd(0)
    moved = crowd.candidates.joints2d.clone()
    moved[:, :, 1:] += torch.tensor([0.0, 400.0])
    candidates = replace(crowd.candidates, joints2d=moved).select([0, 1])
    with pytest.raises(InputError, match="nobody is seen by two views at once"):
        associate(crowd.cameras.select([0, 1]), candidates, RATE)


@pytest.mark.long
def test_bones_tell_who_is_taller() -> None:
    crowd = make_crowd(1, count=3)
    found = associate(crowd.cameras, crowd.candidates, RATE)
    people = crowd.matched(found.slots)[0]
    lengths = tracked_bones(found.points)
    true = torch.stack([tracked_bones(crowd.joints[p]) for p in people])
    assert (lengths / true - 1).abs().max() < 0.06
    assert lengths[:, 5].argsort().tolist() == true[:, 5].argsort().tolist()


def test_groups_of_a_batch_are_those_of_each_frame() -> None:
    crowd = make_crowd(3, frames=6, spoil=0.3)
    config = AssociationConfig()

    def members(candidates: Detections) -> list[list[int]]:
        sightings = Sightings.of(crowd.cameras, candidates, config)
        return sorted(group_views(sightings).members.tolist())

    together = members(crowd.candidates)
    alone = [m for f in range(6) for m in members(crowd.candidates.frames(slice(f, f + 1)))]
    assert together == sorted(alone)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"rate": 0.0}, "expected frames a second"),
        ({"rate": -30.0}, "expected frames a second"),
        ({"rate": "30"}, "expected frames a second"),
        ({"people": 0}, "people is 0, expected a whole number of 1 or more"),
        ({"people": 1.5}, "expected a whole number of 1 or more"),
        ({"people": True}, "expected a whole number of 1 or more"),
        ({"config": {"same": 0.1}}, "expected an AssociationConfig"),
    ],
)
def test_arguments_that_are_none(given: dict[str, Any], words: str) -> None:
    crowd = make_crowd(2, frames=4, views=2)
    with pytest.raises(InputError, match=words):
        associate(crowd.cameras, crowd.candidates, **given)


def test_moving_cameras_of_other_frames() -> None:
    crowd = make_crowd(2, frames=4, views=2)
    moving = crowd.cameras.map(lambda part: part.expand(3, *part.shape))
    with pytest.raises(InputError, match="have 3 frames, candidates 4"):
        associate(moving, crowd.candidates)


def test_cameras_that_are_none_and_joints_that_are_no_pixels() -> None:
    """As ``capture`` has it: people were found all the same, metres from where they are."""
    crowd = make_crowd(2, frames=4, views=2)
    cameras, seen = crowd.cameras, crowd.candidates
    down = cameras.intrinsics * torch.tensor([[1.0, 1, 1], [1, -1, 1], [1, 1, 1]])
    for odd, words in (
        (replace(cameras, rotation=-cameras.rotation), "rotation that is none"),
        (replace(cameras, intrinsics=down), "focal lengths"),
        (replace(cameras, intrinsics=2 * cameras.intrinsics), "last row"),
        (replace(cameras, translation=1000 * cameras.translation), "divide millimetres by 1000"),
    ):
        with pytest.raises(InputError, match=words):
            associate(odd, seen)
    with pytest.raises(InputError, match="multiply normalised joints"):
        associate(cameras, replace(seen, joints2d=seen.joints2d / 2000))
    with pytest.raises(InputError, match="divide percents by 100"):
        associate(cameras, replace(seen, confidence2d=100 * seen.confidence2d))
