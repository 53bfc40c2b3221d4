"""Clocks and cameras of synthetic views: recovered to fractions, and what is refused."""

from dataclasses import replace

import pytest
import torch
from synthetic import actor
from takes import Take, make_take

from perfcap.detect.detections import Detections, at_clock
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.liveliness import least_frames, require_motion
from perfcap.pipeline.view_errors import ViewErrors, solve_views

F64 = torch.float64
LATE = torch.tensor([0.0, 2.5, -0.5], dtype=F64)  # frames


def filmed() -> tuple[Take, Detections]:
    """Three views of a take at four times the rate, each from its own time, with noise."""
    take = make_take(260, views=3, lifted=False, rate=120.0)
    steps = (4 * LATE).long()
    first = [12 - int(step) for step in steps]
    pixels = torch.stack(
        [take.detections.joints2d[f : f + 240 : 4, view] for view, f in enumerate(first)], 1
    )
    random = torch.Generator().manual_seed(7)
    pixels = pixels + torch.randn(pixels.shape, generator=random, dtype=F64)
    return take, Detections.from_joints(pixels, torch.ones(pixels.shape[:-1], dtype=F64))


@pytest.mark.long
def test_clocks_are_found_between_frames() -> None:
    take, detections = filmed()
    found = solve_views(actor(), take.cameras, detections, 30.0)
    assert found.clock is not None and found.clock_deviation is not None
    assert float((found.clock - LATE).abs().max()) < 0.05
    assert float(found.clock_deviation.max()) < 0.15 and float(found.clock_deviation[0]) == 0
    assert "are later than a by b +2." in next(found.sentences(["a", "b", "c"]))
    assert set(found.report(["a", "b", "c"])) == {"clock_frames"}


@pytest.mark.long
def test_cameras_are_brought_together() -> None:
    take, _ = filmed()
    random = torch.Generator().manual_seed(8)
    truth = take.actor.joints(take.truth)[::4]
    pixels = take.cameras.project(truth)
    noise = torch.randn(pixels.shape, generator=random, dtype=F64)
    detections = Detections.from_joints(pixels + noise, torch.ones(pixels.shape[:-1]).double())
    turn = rotvec_to_matrix(0.006 * torch.randn(3, 3, generator=random, dtype=F64))
    stated = replace(
        take.cameras,
        rotation=turn @ take.cameras.rotation,
        translation=(turn @ take.cameras.translation[..., None])[..., 0],
    )
    found = solve_views(actor(), stated, detections, 30.0, sync=False, refine=True)
    assert found.clock is None and found.cameras is not None
    # directions between pairs of cameras, which no motion of the whole world changes
    angles = []
    for cameras in (stated, found.of_cameras(stated)):
        pair = cameras.rotation[0] @ cameras.rotation[1:].mT
        real = take.cameras.rotation[0] @ take.cameras.rotation[1:].mT
        angles.append(float((pair - real).norm()))
    assert angles[1] < 0.35 * angles[0]
    assert found.of_detections(detections) is detections
    assert len(list(found.sentences(["a", "b", "c"]))) == 1


def test_detections_are_moved_in_time() -> None:
    frames = torch.arange(10, dtype=F64)[:, None, None, None].expand(10, 2, 16, 2)
    confidence = torch.ones(10, 2, 16, dtype=F64)
    confidence[4, 1, 0] = 0
    moved = at_clock(
        Detections.from_joints(frames, confidence), torch.tensor([-2.0, 1.25], dtype=F64)
    )
    assert torch.equal(moved.joints2d[2:, 0], frames[:8, 0])
    assert torch.allclose(moved.joints2d[:8, 1], frames[:8, 1] + 1.25)
    assert moved.confidence2d[:2, 0].sum() == 0 and moved.confidence2d[2:, 0].all()
    assert moved.confidence2d[8:, 1].sum() == 0
    assert moved.confidence2d[:5, 1, 0].tolist() == [1, 1, 0, 0, 1]


def test_nothing_found_changes_nothing() -> None:
    take = make_take(20, views=2, lifted=False)
    nothing = ViewErrors()
    assert nothing.of_cameras(take.cameras) is take.cameras
    assert nothing.of_detections(take.detections) is take.detections
    assert list(nothing.sentences(["a", "b"])) == [] and nothing.report(["a", "b"]) == {}


def test_what_cannot_be_solved_is_refused() -> None:
    take = make_take(20, views=2, lifted=False)
    parts = take.cameras, take.detections
    with pytest.raises(InputError, match="one view"):
        solve_views(take.actor, parts[0].select([0]), parts[1].select([0]), 30.0)
    with pytest.raises(InputError, match="one view"):
        solve_views(take.actor, parts[0].select([0]), parts[1], 30.0)
    with pytest.raises(InputError, match="rate is nan"):
        solve_views(take.actor, *parts, float("nan"))
    with pytest.raises(InputError, match="cameras: got a tuple"):
        solve_views(take.actor, (parts[0],), parts[1], 30.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="cameras move"):
        solve_views(take.actor, parts[0].every_frame(20), parts[1], 30.0)
    with pytest.raises(InputError, match="has 9 frames"):
        solve_views(take.actor, parts[0], parts[1].frames(slice(0, 9)), 30.0)


@pytest.mark.parametrize(("rate", "least"), [(10.0, 15), (30.0, 16), (60.0, 32), (300.0, 162)])
def test_short_clips_are_refused_as_short(rate: float, least: int) -> None:
    """And not as of somebody who stands still: the first that is long enough shows its motion."""
    take = make_take(least, views=2, lifted=False, rate=rate)
    short = take.detections.frames(slice(0, least - 1))
    words = f"has {least - 1} frames; clocks at {rate:g} frames a second need {least} or more"
    with pytest.raises(InputError, match=words):
        solve_views(take.actor, take.cameras, short, rate)
    require_motion(take.detections, rate)


@pytest.mark.long
@pytest.mark.parametrize("rate", [30.0, 300.0])
def test_the_shortest_clips_show_clocks(rate: float) -> None:
    take = make_take(least_frames(rate), views=2, lifted=False, rate=rate)
    with pytest.warns(UserWarning, match="clocks of view 1 are not found"):  # to half a frame
        found = solve_views(actor(), take.cameras, take.detections, rate)
    assert found.clock is not None and float(found.clock.abs().max()) < 0.5


def test_places_of_cameras_need_as_many_frames_at_any_rate() -> None:
    take = make_take(14, views=2, lifted=False, rate=60.0)
    with pytest.raises(InputError, match="14 frames; places of cameras need 15 or more"):
        solve_views(actor(), take.cameras, take.detections, 60.0, sync=False, refine=True)


@pytest.mark.long
@pytest.mark.parametrize("correlation", [1, 8])
@pytest.mark.parametrize("rate", [30.0, 120.0])
def test_nobody_who_stands_still_tells_clocks(rate: float, correlation: int) -> None:
    frames = round(2 * rate)
    take = make_take(frames, views=3, lifted=False, rate=rate)
    length = round(correlation * rate / 30)
    random = torch.Generator().manual_seed(3)
    noise = torch.randn(frames + length - 1, 3, 16, 2, generator=random, dtype=F64)
    noise = length**0.5 * noise.unfold(0, length, 1).mean(-1)
    pixels = take.detections.joints2d
    still = replace(take.detections, joints2d=pixels.mean(0) + noise)
    with pytest.raises(InputError, match="the person hardly moves"):
        solve_views(actor(), take.cameras, still, rate)
    moving = replace(take.detections, joints2d=pixels + noise)
    found = solve_views(actor(), take.cameras, moving, rate)
    assert found.clock is not None and float(found.clock.abs().max()) < 0.4
    unseen = Detections.from_joints(pixels, 0 * take.detections.confidence2d)
    with pytest.raises(InputError, match="the person hardly moves"):
        solve_views(actor(), take.cameras, unseen, rate)


def test_large_corrections_are_doubted() -> None:
    moved = torch.zeros(3, 6, dtype=torch.float64)
    moved[:, 3] = 0.02
    small = ViewErrors(None, None, moved, moved)
    assert len(list(small.sentences(["a", "b", "c"]))) == 1
    moved = moved.clone()
    moved[1, 4] = 0.2
    _, doubt = ViewErrors(None, None, moved, moved).sentences(["a", "b", "c"])
    assert "more than a small error of b:" in doubt


@pytest.mark.long
def test_cameras_with_a_wrong_lens_are_moved_far_and_named() -> None:
    """They agree once they are moved, so that a capture has nothing to say."""
    take, _ = filmed()
    pixels = take.cameras.project(take.actor.joints(take.truth)[::4])
    detections = Detections.from_joints(pixels, torch.ones(pixels.shape[:-1]).double())
    lens = take.cameras.intrinsics.clone()
    lens[1, :2, :2] *= 1.25
    stated, given = replace(take.cameras, intrinsics=lens), {"sync": False, "refine": True}
    with pytest.warns(UserWarning, match="solve_views: that is more than a small error of .*view"):
        found = solve_views(actor(), stated, detections, 30.0, **given)
    assert list(found.doubts(["a", "b", "c"])) == list(found.sentences(["a", "b", "c"]))[1:]
    solve_views(actor(), stated, detections, 30.0, **given, examined=True)


@pytest.mark.long
@pytest.mark.parametrize("blind", [True, False])
def test_clocks_that_nothing_tells_are_left_alone(blind: bool) -> None:
    take, detections = filmed()
    pixels, seen = detections.joints2d.clone(), detections.confidence2d.clone()
    pixels[:, 1], seen[:, 1] = pixels[:1, 1], 1 - float(blind)
    with pytest.warns(UserWarning, match="clocks of view 1 are not found"):
        found = solve_views(actor(), take.cameras, Detections.from_joints(pixels, seen), 30.0)
    assert found.clock is not None and float(found.clock[1]) == 0
    assert abs(float(found.clock[2]) + 0.5) < 0.1
    told = list(found.sentences(["a", "b", "c"]))
    assert len(told) == 2 and "clocks of b are not found" in told[1]


@pytest.mark.long
def test_joints_that_are_no_numbers_are_unseen() -> None:
    take, detections = filmed()
    pixels = detections.joints2d.clone()
    pixels[10:13] = float("nan")
    lost = Detections.from_joints(pixels, detections.confidence2d)
    found = solve_views(actor(), take.cameras, lost, 30.0)
    assert found.clock is not None and float((found.clock - LATE).abs().max()) < 0.1


def test_clocks_that_may_be_whole_are_taken_so() -> None:
    """A wrong joint of a frame spoils no other, and the ends of the clip stay."""
    clock = torch.tensor([0.0, -0.04, -1.06, 0.52, 0.9], dtype=F64)
    found = ViewErrors(clock, torch.tensor([0.0, 0.06, 0.05, 0.06, 0.3], dtype=F64))
    assert found.late is not None
    torch.testing.assert_close(found.late, torch.tensor([0, 0, -1.06, 0.52, 1], dtype=F64))
    pixels = torch.arange(8, dtype=F64)[:, None, None, None].expand(8, 5, 16, 2)
    moved = found.of_detections(Detections.from_joints(pixels, torch.ones(8, 5, 16).double()))
    assert torch.equal(moved.joints2d[:, 1], pixels[:, 1]) and moved.confidence2d[:, 1].all()
    assert torch.allclose(moved.joints2d[:7, 3], pixels[:7, 3] + 0.52)


def test_images_lag_behind_clocks_between_frames() -> None:
    clock, sure = torch.tensor([0.0, -1.4, 0.7], dtype=F64), torch.full((3,), 0.05, dtype=F64)
    found = ViewErrors(clock, sure)
    lag = found.lag(range(3), [3, 3, 3])
    assert lag is not None and lag.shape == (3, 3)
    # frame 1 of the motion is at -0.4 of the second view, whose frame 0 is 0.4 later
    torch.testing.assert_close(lag[1], torch.tensor([0, 0.4, 0.3], dtype=F64))
    assert lag.isnan().tolist() == [[False, True, False], [False] * 3, [False, False, True]]
    longer = found.lag(range(2, 5), [9, 9, 9])  # a part of videos that go on
    assert longer is not None and not bool(longer.isnan().any())
    assert ViewErrors().lag(range(3), [3]) is None
    assert ViewErrors(0 * clock, sure).lag(range(3), [3, 3, 3]) is None
