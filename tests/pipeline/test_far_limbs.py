"""Limbs that a motion has elsewhere than several views see them, and frames that are named."""

from dataclasses import replace

import pytest
import torch
from takes import Take, circle, detect, make_take

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.far_limbs import FarLimb, far_limbs, without_far_limbs
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.trust import THRESHOLD, Trust

SPAN = slice(8, 13)


def take_of(views: int = 4) -> Take:
    """A person whom cameras on a full circle see."""
    take = make_take(20, views=1, lifted=False)
    cameras = circle(views, size=600)
    return replace(take, cameras=cameras, detections=detect(take.actor, cameras, take.truth, False))


def problem(take: Take, detections: Detections | None = None) -> ClipProblem:
    seen = take.detections if detections is None else detections
    return ClipProblem.of(FrameProblem.of(take.actor, take.cameras, seen), take.rate)


def elsewhere(
    take: Take, views: list[int], side: str = "r", limb: str = "leg", span: slice = SPAN
) -> Detections:
    """With the joints of a limb half a metre away from the motion, as some views see them."""
    names = ("knee", "ankle", "toe") if limb == "leg" else ("elbow", "wrist")
    index = [LANDMARKS.index(f"{side}_{name}") for name in names]
    places = take.actor.joints(take.truth).clone()
    places[:, index] += torch.tensor(
        [0.35, 0.1 if limb == "leg" else 0.5, 0.35], dtype=places.dtype
    )
    pixels, joints = take.cameras.project(places), take.detections.joints2d.clone()
    for view in views:
        joints[span, view] = pixels[span, view]
    changed: Detections = replace(take.detections, joints2d=joints)
    return changed


def named(take: Take, detections: Detections, *others: Motion) -> list[FarLimb]:
    return list(far_limbs(problem(take, detections), (take.truth, *others)))


@pytest.mark.parametrize("limb", ["leg", "arm"])
@pytest.mark.parametrize("side", ["l", "r"])
def test_a_limb_that_two_of_four_views_see_elsewhere_is_named(limb: str, side: str) -> None:
    take = take_of()
    (found,) = named(take, elsewhere(take, [0, 3], side, limb))
    assert found == FarLimb(limb, SPAN.start, SPAN.stop, (0, 3))


def test_a_leg_that_one_of_the_views_calls_left_is_named() -> None:
    """As where two views exchange legs, and the motion has both in one place."""
    take = take_of()
    seen = elsewhere(take, [0, 3])
    (found,) = named(take, replace(seen, joints2d=exchanged(seen.joints2d, 3)))
    assert (found.start, found.stop, found.views) == (SPAN.start, SPAN.stop, (0, 3))


def exchanged(joints: torch.Tensor, view: int) -> torch.Tensor:
    """With left and right legs exchanged in a view, in a few frames."""
    legs = [[LANDMARKS.index(f"{s}_{n}") for n in ("knee", "ankle", "toe")] for s in "lr"]
    changed = joints.clone()
    for to, of in (legs, legs[::-1]):
        changed[SPAN, view, to] = joints[SPAN, view, of]
    return changed


def test_right_motions_are_not_named() -> None:
    take = take_of()
    seen = take.detections
    assert not named(take, seen)
    both = exchanged(exchanged(seen.joints2d, 0), 3)
    assert not named(take, replace(seen, joints2d=both))  # views are wrong, the motion is not
    assert not named(take, elsewhere(take, [0]))
    assert not named(take, elsewhere(take, [0, 3], span=slice(8, 10)))  # two frames
    one = make_take(20, lifted=False)
    assert not named(one, one.detections)


def test_three_views_bear_a_limb_out() -> None:
    take = take_of(6)
    assert not named(take, elsewhere(take, [0, 1, 2]))
    assert named(take, elsewhere(take, [0, 1, 2, 3]))


def test_views_that_agree_on_no_place_contradict_nothing() -> None:
    take = take_of()
    seen = elsewhere(take, [0])
    joints, legs = seen.joints2d.clone(), [LANDMARKS.index(f"r_{n}") for n in ("ankle", "toe")]
    joints[SPAN, 3, legs] -= torch.tensor([0.0, 200.0], dtype=joints.dtype)
    assert not named(take, replace(seen, joints2d=joints))


def test_joints_that_views_are_not_sure_of_contradict_nothing() -> None:
    take = take_of()
    seen = elsewhere(take, [0, 3])
    confidence = seen.confidence2d.clone()
    confidence[SPAN, :, 8:] *= 0.1
    assert not named(take, replace(seen, confidence2d=confidence))


def test_limbs_that_silhouettes_put_aside_or_right_are_not_named() -> None:
    """Far in the result alone, or in the motion of joints alone."""
    take = take_of()
    seen = elsewhere(take, [0, 3])
    assert named(take, seen, take.truth)
    place = take.truth.translation + torch.tensor([0.35, 0.1, 0.35], dtype=torch.float64)
    there = replace(take.truth, translation=place)  # where both views see the leg
    assert not named(take, seen, there)


def test_frames_are_not_trusted_and_named_once_with_views() -> None:
    take = take_of()
    count = take.truth.frames
    value = torch.full((count,), 0.95, dtype=torch.float64)
    before = Trust(value, 100 * (1 - value), ((7, 10, "another reason"),))
    seen = problem(take, elsewhere(take, [0, 3]))
    names = ["front", "right", "back", "left"]
    after = without_far_limbs(before, seen, (take.truth,), names)
    low = after.value < THRESHOLD
    assert low.nonzero()[:, 0].tolist() == list(range(SPAN.start, SPAN.stop))
    assert float(after.error[SPAN].min()) > 30 and float(after.error[0]) == pytest.approx(5)
    (kept, why) = after.doubtful
    assert kept == (7, 8, "another reason") and why[:2] == (SPAN.start, SPAN.stop)
    assert "views front and left see joints of a leg far from both legs of the motion" in why[2]
    assert without_far_limbs(before, problem(take), (take.truth,), names) is before
