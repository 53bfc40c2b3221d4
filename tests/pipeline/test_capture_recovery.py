"""Captures of exact detections find the motion they were made from."""

from dataclasses import replace
from typing import Any

import pytest
import torch
from synthetic import clavicled
from takes import make_take

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.config import MONOPERFCAP_POSE, PoseConfig
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.prepare import prepare
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.track_motion import track_motion


def run(take: Any, config: PoseConfig | None = None, **options: Any) -> Performance:
    return capture(
        take.actor,
        take.cameras,
        take.detections,
        take.rate,
        CaptureConfig(config or PoseConfig()),
        **options,
    )


# Mean error allowed, mm. One view keeps the bias of what it cannot see (the spine bends, so its
# length is not the retargeted one) and of the smoothness at the ends; about twice what is found.
ONE_VIEW, TWO_VIEWS = 20.0, 4.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("options", "allowed"),
    [
        pytest.param({}, ONE_VIEW, id="one view with 3D"),
        pytest.param({"turns": 0.5}, ONE_VIEW, id="one view, a full turn"),
        pytest.param({"moving": True}, ONE_VIEW, id="moving camera"),
        pytest.param({"rate": 25.0}, ONE_VIEW, id="25 Hz"),
        pytest.param({"rate": 60.0, "turns": 0.5, "frames": 120}, ONE_VIEW, id="60 Hz, turning"),
        pytest.param({"views": 2, "lifted": False}, TWO_VIEWS, id="two views, 2D"),
        pytest.param(
            {"views": 2, "lifted": False, "moving": True, "turns": 0.5}, TWO_VIEWS, id="all at once"
        ),
    ],
)
def test_finds_the_motion(options: dict[str, Any], allowed: float) -> None:
    take = make_take(**options)
    performance = run(take)
    assert performance.complete and performance.gaps == ()
    assert performance.frames == take.truth.frames
    assert take.error_mm(performance.joints()).mean() < allowed


def test_a_turning_person_turns_without_a_jump() -> None:
    """Rotation vectors jump by a turn half-way round; joints must not."""
    take = make_take(60, turns=0.5)
    joints, truth = run(take).joints(), take.actor.joints(take.truth)
    speed, true_speed = (x.diff(dim=0).norm(dim=-1).amax() for x in (joints, truth))
    assert speed < 1.3 * true_speed


@pytest.mark.long
@pytest.mark.parametrize("frames", [1, 2, 3, 17, 49, 50, 51, 89, 90, 91])
def test_any_length_of_clip(frames: int) -> None:
    take = make_take(frames, views=2, lifted=False)
    performance = run(take)
    assert performance.frames == frames
    assert take.error_mm(performance.joints()).mean() < 10
    covered = {f for w in performance.windows for f in range(w.window.start, w.window.stop)}
    assert covered == set(range(frames))


def test_one_view_without_3d_stays_close_where_the_start_is_good() -> None:
    take = make_take(4, lifted=False)
    performance = run(take)
    assert take.error_mm(performance.joints()).mean() < 150  # depth is anybody's guess
    pixels = take.cameras.project(performance.joints())
    assert (pixels - take.detections.joints2d).norm(dim=-1).mean() < 4


@pytest.mark.long
@pytest.mark.parametrize("until", [s for s in Stage if not s.needs_images])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_angles_never_leave_their_limits(until: Stage, dtype: torch.dtype) -> None:
    """Joints no pose within the limits can reach push every angle against its bound."""
    take = make_take(12, views=3, lifted=False)
    wild = take.detections.joints2d.clone()
    random = torch.Generator().manual_seed(3)
    wild += 60 * torch.randn(wild.shape, generator=random, dtype=wild.dtype)
    detections = replace(take.detections, joints2d=wild).to(torch.zeros((), dtype=dtype))
    config = CaptureConfig(PoseConfig(window=8, overlap=3))
    performance = capture(take.actor, take.cameras, detections, 30.0, config, until=until)
    skeleton, angles = performance.actor.skeleton, performance.motion.angles
    assert angles.dtype == dtype
    assert bool((angles >= skeleton.lower).all()) and bool((angles <= skeleton.upper).all())
    at_limit = (angles == skeleton.lower) | (angles == skeleton.upper)
    assert at_limit.any()  # or the test would say nothing


@pytest.mark.long
def test_the_same_call_gives_the_same_bits() -> None:
    take = make_take(55)
    first, second = run(take).motion, run(take).motion
    for name in ("translation", "rotation", "angles"):
        assert torch.equal(getattr(first, name), getattr(second, name))


@pytest.mark.long
def test_a_batch_of_windows_equals_one_by_one() -> None:
    take = make_take(100, views=2, lifted=False)
    together, alone = (
        run(take, replace(PoseConfig(), window=30, batch=batch, initial_batch=part))
        for batch, part in ((8, 512), (1, 7))
    )
    assert [w.window for w in together.windows] == [w.window for w in alone.windows]
    assert torch.allclose(together.joints(), alone.joints(), atol=1e-5)


def test_published_constants_run_too() -> None:
    take = make_take(50)
    performance = run(take, MONOPERFCAP_POSE)
    assert performance.complete
    assert take.error_mm(performance.joints()).mean() < 40


@pytest.mark.long
def test_clavicles_turn_unless_the_constants_are_published() -> None:
    actor = Actor(clavicled())
    assert actor.skeleton.rig.clavicles
    take = make_take(50, views=3, lifted=False, actor=actor)
    performance = run(take)
    assert performance.actor.skeleton.rig.clavicles == actor.skeleton.rig.clavicles
    assert take.error_mm(performance.joints()).mean() < 2
    published = run(take, MONOPERFCAP_POSE, until=Stage.INITIALIZE)
    assert not published.actor.skeleton.rig.clavicles


def test_until_initialize_solves_no_window() -> None:
    take = make_take(20, views=2, lifted=False)
    performance = run(take, until=Stage.INITIALIZE)
    assert performance.windows == ()
    assert [s.name for s in performance.stages] == ["initialize"]
    assert take.error_mm(performance.joints()).median() < 2


@pytest.mark.long
def test_progress_tells_every_stage_to_its_end() -> None:
    told: list[tuple[str, int, int]] = []
    run(make_take(60), progress=lambda *what: told.append(what))
    for stage in ("initialize", "track_motion"):
        seen = [(done, total) for name, done, total in told if name == stage]
        assert seen[-1][0] == seen[-1][1]
        assert all(0 <= done <= total for done, total in seen)


def test_a_truth_that_is_smooth_stays_where_it_is() -> None:
    """Tracking from the truth, with what it would detect, moves nothing by more than the prior."""
    take = make_take(50, views=3, lifted=False)
    frames = FrameProblem.of(take.actor, take.cameras, take.detections)
    problem = ClipProblem.of(frames, take.rate)
    motion, _ = track_motion(problem, take.truth)
    assert take.error_mm(take.actor.joints(motion)).mean() < 3


def test_frames_of_the_start_do_not_know_each_other() -> None:
    """Initialisation is per frame: any part of a clip gives that part's poses."""
    take = make_take(12, views=2, lifted=False)
    frames = FrameProblem.of(take.actor, take.cameras, take.detections)

    def start(part: slice) -> Motion:
        return initialize(prepare(frames.frames(part)))[0]

    whole, part = start(slice(0, 12)), start(slice(5, 9))
    assert torch.allclose(whole.angles[5:9], part.angles, atol=1e-6)
    assert torch.allclose(whole.translation[5:9], part.translation, atol=1e-6)


@pytest.mark.long
def test_the_caller_s_actor_stays_as_it_is() -> None:
    take = make_take(3)
    like = torch.zeros((), dtype=torch.float32)
    performance = capture(take.actor, take.cameras, take.detections.to(like), take.rate)
    assert take.actor.vertices.dtype == torch.float64
    assert performance.actor.vertices.dtype == performance.motion.angles.dtype == torch.float32
    wide = performance.to(torch.zeros((), dtype=torch.float64))
    assert wide.joints().dtype == torch.float64
    assert performance.actor.vertices.dtype == torch.float32
    torch.testing.assert_close(wide.joints().float(), performance.joints())
