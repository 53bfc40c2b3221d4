"""Bone lengths from detections of a person who is not the template."""

from dataclasses import replace

import pytest
import torch
from synthetic import actor
from takes import make_take, without

from perfcap.errors import InputError
from perfcap.pipeline.bone_lengths import solve_bone_lengths, spread_frames
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.objective import FrameProblem


def random_shape(groups: int, seed: int) -> torch.Tensor:
    """A person of another size with proportions of their own."""
    random = torch.Generator().manual_seed(seed)
    size, own = torch.randn(1, generator=random), torch.randn(groups, generator=random)
    return (0.06 * size + 0.05 * own).double()


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_three_views_tell_every_length_to_a_percent(seed: int) -> None:
    template = actor()
    shape = random_shape(len(template.skeleton.group_names), seed)
    take = make_take(60, views=3, lifted=False, actor=template.resized(shape))
    performance = capture(template, take.cameras, take.detections, 30.0, solve_bones=True)
    assert performance.bone_scales is not None
    assert (performance.bone_scales - shape).abs().max() < 0.01
    assert take.error_mm(performance.joints()).mean() < 4
    scales = performance.report()["bone_scales"]
    assert list(scales) == list(template.skeleton.group_names)
    assert scales["thigh"] == pytest.approx(float(shape.exp()[-3]), rel=0.01)
    # the result is on an actor that has these lengths
    torch.testing.assert_close(
        performance.actor.skeleton.rest_landmarks,
        template.resized(performance.bone_scales).skeleton.rest_landmarks,
    )


def test_the_template_s_own_detections_change_nothing() -> None:
    take = make_take(30, views=3, lifted=False)
    shape = solve_bone_lengths(FrameProblem.of(take.actor, take.cameras, take.detections))
    assert shape.abs().max() < 0.01


def test_one_view_is_refused_and_so_are_views_that_never_show_the_person_at_once() -> None:
    one, two = make_take(5, views=1), make_take(6, views=2)
    confidence = two.detections.confidence2d.clone()
    confidence[:3, 0] = confidence[3:, 1] = 0
    handed = replace(two, detections=replace(two.detections, confidence2d=confidence))
    for take in (one, handed):
        with pytest.raises(InputError, match="no frame shows 6 joints in two views at once"):
            capture(take.actor, take.cameras, take.detections, 30.0, solve_bones=True)


def test_directions_of_3d_joints_that_are_off_shorten_no_bones() -> None:
    take = make_take(20, views=2)
    found = take.detections
    assert found.joints3d is not None
    random = torch.Generator().manual_seed(0)
    noise = 0.1 * torch.randn(found.joints3d[:1].shape, generator=random, dtype=torch.float64)
    off = replace(found, joints3d=found.joints3d + noise)
    shape = solve_bone_lengths(FrameProblem.of(take.actor, take.cameras, off))
    assert shape.abs().max() < 0.02


def test_spread_frames_covers_the_clip_and_prefers_seen_ones() -> None:
    take = make_take(40)
    chosen = spread_frames(without(take.detections, slice(0, 20)), 8)
    assert chosen.tolist() == sorted(set(chosen.tolist()))
    assert len(chosen) == 4 and chosen.min() >= 20
    partly = take.detections.confidence2d.clone()
    partly[1::2, :, 8:] = 0
    halves = spread_frames(replace(take.detections, confidence2d=partly), 10)
    assert (halves % 2 == 0).all() and len(halves) == 10


@pytest.mark.parametrize(("frames", "count"), [(1, 60), (5, 60), (60, 60), (61, 60)])
def test_spread_frames_of_short_clips(frames: int, count: int) -> None:
    chosen = spread_frames(make_take(frames).detections, count)
    assert len(chosen) == min(frames, count)
    assert chosen.min() >= 0 and chosen.max() < frames
