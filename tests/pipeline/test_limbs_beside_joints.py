"""Limbs that images put far from where joints of several views have them are not trusted."""

from dataclasses import replace

import pytest
import torch
from crowds import RATE, make_crowd
from painted_crowd import PaintedCrowd
from takes import make_take
from test_frame_by_frame import QUICK

import perfcap
from perfcap.actor.motion import Motion
from perfcap.detect.association import associate
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.presets import LIU
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.trust import THRESHOLD, Trust, judge_motion

FRAMES = 60
WRONG = slice(20, 40)
CROWD = make_crowd(3, frames=9, views=5, size=200, noise=4.0)  # in which limbs go half a metre
PAINTED = PaintedCrowd(CROWD)
WHY = "limbs are far from where joints"


def judged(views: int, lost: slice = slice(0, 0), turn: float = 1.4) -> tuple[Trust, Trust]:
    """Of a motion whose right arm images turned by so many radians, and without the comparison.

    Args:
        views: cameras.
        lost: frames in which no joint is detected.
        turn: of the shoulder.
    """
    take = make_take(FRAMES, views=views)
    confidence = take.detections.confidence2d.clone()
    confidence[lost] = 0
    detections = replace(take.detections, confidence2d=confidence)
    problem = ClipProblem.of(FrameProblem.of(take.actor, take.cameras, detections), take.rate)
    angles = take.truth.angles.clone()
    name = next(n for n in take.actor.skeleton.angle_names if n.startswith("r_shoulder"))
    angles[WRONG, take.actor.skeleton.angle_names.index(name)] += turn
    moved: Motion = replace(take.truth, angles=angles)
    return judge_motion(problem, moved, take.truth), judge_motion(problem, moved)


def test_frames_in_which_images_moved_a_limb_away_are_named() -> None:
    found, alone = judged(3)
    # the detections of the arm speak against it as well, but do not say why
    assert (alone.value[WRONG] < THRESHOLD).all()
    assert not any(WHY in why for _, _, why in alone.doubtful)
    ((start, stop, why),) = found.doubtful
    assert (start, stop) == (WRONG.start, WRONG.stop) and WHY in why
    assert found.value[WRONG].max() < 1 - THRESHOLD
    assert torch.equal(found.value[: WRONG.start], alone.value[: WRONG.start])
    assert found.considerable and (found.error >= alone.error).all()


def test_limbs_that_moved_a_little_stay_trusted() -> None:
    found, alone = judged(4, turn=0.3)
    assert torch.equal(found.value, alone.value) and not found.doubtful


@pytest.mark.parametrize("views", [1, 2])
def test_few_views_do_not_contradict_images(views: int) -> None:
    found, alone = judged(views)
    assert torch.equal(found.value, alone.value)


def test_joints_that_are_not_trusted_contradict_nothing() -> None:
    found, alone = judged(4, lost=slice(10, 50))
    assert torch.equal(found.value[22:38], alone.value[22:38])
    assert not any(WHY in why for start, stop, why in found.doubtful if start > 15 and stop < 45)


class Still:
    """Videos that stay at their first frame, while the people whose joints were found go on."""

    def __len__(self) -> int:
        return len(PAINTED)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        return PAINTED.read_view(view, 0, 1).repeat(stop - start, 0)


@pytest.mark.long
def test_people_who_are_followed_in_other_images_than_their_joints_are_named() -> None:
    seen = associate(CROWD.cameras, CROWD.candidates, RATE)
    owners, _ = CROWD.matched(seen.slots)
    pairs = zip(owners, seen.people, strict=True)
    people = tuple(perfcap.Person(CROWD.actors[k], each) for k, each in pairs)
    scene = perfcap.Scene(CROWD.cameras, people, RATE, Images(Still(), CROWD.cameras))
    config = replace(LIU, frames=QUICK)
    found = perfcap.capture(scene, config=config, workers=1, until=Stage.REFINE_POSE)
    named = [each.trust.doubtful for each in found if each.trust is not None]
    assert len(named) == len(people)
    ends = [stop for person in named for _, stop, why in person if WHY in why]
    assert ends == [len(PAINTED)] * len(people)
