"""Frames of which one view shows 2D joints only find their own pose."""

import math
from dataclasses import replace

import pytest
import torch
from takes import Take, make_take, without

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.gaps import fill_gaps
from perfcap.pipeline.initialize import (
    _standing_start,
    initialize,
    joint_places,
    search_headings,
)
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import prepare

FRAMES = 12
FIRST, SECOND = slice(0, 1), slice(1, 2)


def pair(**options: bool) -> Take:
    """Two views, 2D, of a person who turns by 70 degrees."""
    return make_take(FRAMES, views=2, lifted=False, turns=0.5, **options)


def start(take: Take, detections: Detections, views: list[int] | None = None) -> Motion:
    """The motion that a capture of some views starts from."""
    views = views or list(range(detections.views))
    cameras, detections = take.cameras.select(views), detections.select(views)
    return initialize(prepare(FrameProblem.of(take.actor, cameras, detections)))[0]


def problem(take: Take, batch: int = PoseConfig().initial_batch) -> FrameProblem:
    config = PoseConfig(initial_batch=batch)
    return FrameProblem.of(take.actor, take.cameras, take.detections, config)


def errors(take: Take, motion: Motion) -> torch.Tensor:
    return take.error_mm(take.actor.joints(motion))


def test_frames_long_after_the_last_3d_pose_do_not_hold_it() -> None:
    take = make_take(FRAMES, turns=1.5)  # in a third of a second, half turned about
    trusted = take.detections.trusted3d.clone()
    trusted[1:] = False
    found = errors(take, start(take, replace(take.detections, trusted3d=trusted)))
    held = errors(take, fill_gaps(take.truth, torch.arange(FRAMES) < 1))
    assert found[0] < 20
    assert found[8:].mean() < 0.5 * held[8:].mean()


def test_a_view_that_never_sees_the_person_changes_nothing() -> None:
    take = pair(moving=True)
    alone = start(take, take.detections, [1])
    both = start(take, without(take.detections, slice(None), FIRST))
    for name in ("translation", "rotation", "angles"):
        assert torch.equal(getattr(both, name), getattr(alone, name))


@pytest.mark.long
def test_views_that_hand_the_person_over_start_as_each_alone() -> None:
    take = pair()
    early = without(take.detections, slice(6, None), FIRST)
    found = start(take, without(early, slice(0, 6), SECOND))
    for view, part in enumerate((slice(0, 6), slice(6, None))):
        alone = start(take, take.detections.frames(part), [view])  # its pixels have the same unit
        torch.testing.assert_close(found.translation[part], alone.translation)
        torch.testing.assert_close(found.angles[part], alone.angles)


def test_a_short_gap_keeps_what_lies_between() -> None:
    """There the other view's depth is better than what one view makes of it."""
    take = pair()
    gap = start(take, without(take.detections, slice(5, 7), SECOND))
    assert errors(take, gap)[5:7].max() < 20


def test_frames_that_nobody_sees_lie_between_those_found() -> None:
    take = make_take(FRAMES, lifted=False)
    found = start(take, without(take.detections, slice(5, 8)))
    middle = found.translation[[4, 8]].mean(0)
    torch.testing.assert_close(found.translation[6], middle)


def test_many_frames_are_searched_in_parts() -> None:
    take = make_take(6, lifted=False)
    rest = take.actor.skeleton.rest_motion(6)
    none = torch.zeros(6, dtype=torch.bool)
    whole, found = search_headings(problem(take), rest, none)
    parts, _ = search_headings(problem(take, batch=4), rest, none)
    assert found.all() and not none.any()
    torch.testing.assert_close(parts.angles, whole.angles)


def test_known_frames_and_those_around_are_left_alone() -> None:
    take = make_take(8, lifted=False)
    known = torch.ones(8, dtype=torch.bool)
    motion, found = search_headings(problem(take), take.truth, known)
    assert motion is take.truth and torch.equal(found, known)
    known[1:] = False
    motion, found = search_headings(problem(take), take.truth, known)
    assert torch.equal(motion.angles[0], take.truth.angles[0])
    assert found.tolist() == [True, *5 * [False], True, True]


def test_two_joints_in_each_of_two_views_are_nobody() -> None:
    take = pair()
    confidence = torch.zeros_like(take.detections.confidence2d)
    confidence[:, 0, :2], confidence[:, 1, 4:6] = 1, 1
    with pytest.raises(InputError, match="in no frame"):
        start(take, replace(take.detections, confidence2d=confidence))


def test_3d_joints_of_several_views_are_averaged_where_2d_joints_are_missing() -> None:
    take = make_take(FRAMES, views=2)
    unseen = torch.zeros_like(take.detections.confidence2d)
    prepared = prepare(problem(take))
    assert prepared.lifted is not None and bool(prepared.detections.trusted3d.all())
    seen = replace(prepared.detections, confidence2d=unseen)
    blind = replace(prepared, problem=replace(prepared.problem, detections=seen))
    points, weights = joint_places(blind)
    torch.testing.assert_close(points, prepared.lifted.mean(1))
    assert (weights == 1).all()


def test_headings_are_of_people_upright_in_the_image() -> None:
    take = make_take(FRAMES, views=1, lifted=False)
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    ahead = []
    for yaw in (0.0, 0.8, 4.0):
        start = _standing_start(problem(take), yaw)
        turn = take.cameras.rotation[..., 0, :, :] @ rotvec_to_matrix(start.rotation)
        torch.testing.assert_close(turn @ up, -up.expand(FRAMES, 3))  # y is down in a camera
        ahead.append(turn[0] @ up.roll(1))
    assert float(ahead[0] @ ahead[1]) == pytest.approx(math.cos(0.8))
    assert float(ahead[0] @ ahead[2]) == pytest.approx(math.cos(4.0))
