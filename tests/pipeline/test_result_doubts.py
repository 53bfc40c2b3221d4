"""What is told of captured motions that are none of a person."""

from dataclasses import replace

import pytest
import torch
from takes import Take, make_take, sway

from perfcap.errors import InputError
from perfcap.pipeline import capture
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.result_doubts import result_doubts


def problem(take: Take) -> ClipProblem:
    return ClipProblem.of(FrameProblem.of(take.actor, take.cameras, take.detections), take.rate)


def test_a_person_four_kilometres_away_is_told() -> None:
    take = make_take(4)
    here = sway(take.actor, 4)
    far = replace(here, translation=here.translation + 4000.0)
    (told,) = result_doubts(problem(take), far, solved_bones=False)
    assert "m from the cameras" in told
    assert not list(result_doubts(problem(take), here, solved_bones=True))


def test_a_person_who_jumps_to_another_is_told() -> None:
    take = make_take(6)
    here = sway(take.actor, 6)
    there = here.translation.clone()
    there[4:, 0] += 0.6
    moved = replace(here, translation=there)
    (told,) = result_doubts(problem(take), moved, solved_bones=False)
    assert "jumps up to 0.6" in told and "(frames 4 of the capture, counted from 0)" in told


@pytest.mark.parametrize(("factor", "told"), [(0.4, True), (-0.7, True), (0.0, False)])
def test_people_whom_the_cameras_make_too_tall_are_told(factor: float, told: bool) -> None:
    take = make_take(4)
    here = sway(take.actor, 4)
    scales = torch.full((len(take.actor.skeleton.group_names),), factor, dtype=torch.float64)
    parts = replace(problem(take), actor=take.actor.resized(scales)), here
    assert ["tall by the cameras" in line for line in result_doubts(*parts, True)] == [True] * told
    assert not list(result_doubts(*parts, solved_bones=False))


def test_a_motion_that_is_cut_alone_is_refused() -> None:
    take = make_take(6)
    found = capture(take.actor, take.cameras, take.detections, take.rate)
    with pytest.raises(InputError, match=r"performance: has \{'motion': 4, .*'trust': 6"):
        replace(found, motion=found.motion[1:5])
    whole = replace(found, contact=None, trust=None, windows=())
    assert replace(whole, motion=found.motion[1:5]).frames == 4


def test_captures_in_python_tell_it() -> None:
    """A focal length ten thousand times too long makes a person far away."""
    take = make_take(4)
    lens = take.cameras.intrinsics.clone()
    lens[:, 0, 0] *= 1e4
    lens[:, 1, 1] *= 1e4
    cameras = replace(take.cameras, intrinsics=lens)
    found = capture(take.actor, cameras, take.detections, take.rate)
    assert any("m from the cameras" in line for line in found.warnings)


def test_gaps_beyond_a_capture_are_refused() -> None:
    """Those below zero were frames at the end."""
    take = make_take(6)
    found = capture(take.actor, take.cameras, take.detections, take.rate)
    for change in ({"gaps": ((-5, -2),)}, {"gaps": ((4, 7),)}, {"gaps": ((3, 3),)}, {"lost": -1}):
        with pytest.raises(InputError, match=r"^performance: has gaps"):
            replace(found, **change)


@pytest.mark.parametrize("up", [(0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)])
def test_another_axis_than_up(up: tuple[float, float, float]) -> None:
    """Feet are put on a floor there: 114 instead of 30 mm on one recording, and no word."""
    take = make_take(6)
    here = sway(take.actor, 6)
    given = here.angles.new_tensor(up)
    body = take.actor.joints(here)
    shown = -take.cameras.rotation[:, 1].mean(0)
    assert float((body[:, 1] - body[:, [8, 12]].mean(1)).mean(0) @ shown) > 0.3  # upright in images
    ((told),) = result_doubts(replace(problem(take), up=given), here, solved_bones=False)
    assert "check axis and sign" in told
    assert not list(result_doubts(replace(problem(take), up=shown / shown.norm()), here, False))


def test_who_lies_and_cameras_on_their_sides_are_not_named() -> None:
    take = make_take(6)
    here = sway(take.actor, 6)
    turn = here.angles.new_tensor([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    camera = replace(
        take.cameras,
        rotation=turn @ take.cameras.rotation,
        translation=(turn @ take.cameras.translation[..., None])[..., 0],
    )
    shown = -take.cameras.rotation[:, 1].mean(0)
    across = -camera.rotation[:, 1].mean(0)
    aside = replace(problem(take), cameras=camera)
    # the camera on its side, and up as it is; people who lie, in a camera that is level
    assert not list(result_doubts(replace(aside, up=shown), here, solved_bones=False))
    assert not list(result_doubts(replace(aside, up=across), here, solved_bones=False))
