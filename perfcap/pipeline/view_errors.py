"""Clocks and places of cameras that are slightly wrong: solved with the motion of a stretch."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections, at_clock
from perfcap.energy.uncertain_views import CAMERAS, CLOCK
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.triangulation import triangulate
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.input_checks import require_kinds, require_matching
from perfcap.pipeline.liveliness import least_frames, liveliest, require_motion
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import prepare, relaxed
from perfcap.pipeline.uncertain_problem import UncertainProblem
from perfcap.rates import frame_rate
from perfcap.setting_checks import Settings

_MUCH = 3.0  # deviations, beyond which a correction is no small one
_WHOLE = 0.1  # frames that a clock may be off where it is taken for a whole number
_LEAST = 15  # frames, of cameras and clocks
_UNKNOWN = 0.5  # frames of deviation, beyond which a clock is not found: others have 0.05 to 0.2


@dataclass(frozen=True)
class ViewErrorConfig(Settings):
    """How errors of views are found.

    Attributes:
        frames: the liveliest stretch of so many is looked at.
        reach: seconds by which clocks may differ, either way.
        clock: deviation of clocks about what the search for whole frames finds, frames.
        turn: deviation of the directions of cameras, radians.
        shift: deviation of their places, metres.
        rounds: of solving; each starts from poses of views as the last one corrected them.
        steps: of the solver in a round.
    """

    frames: int = 150
    reach: float = 0.5
    clock: float = 1.0
    turn: float = 0.01
    shift: float = 0.03
    rounds: int = 2
    steps: int = 30


@dataclass(frozen=True)
class ViewErrors:
    """What was found, with standard deviations.

    Attributes:
        clock: frames by which each view is later than the first, (C,), 0 where that is not found;
            None where not asked for.
        clock_deviation: likewise, (C,); more than half a frame where nothing was found.
        cameras: rotation vectors and shifts in each camera's axes, (C, 6), radians and metres.
        cameras_deviation: likewise, (C, 6).
    """

    clock: Tensor | None = None
    clock_deviation: Tensor | None = None
    cameras: Tensor | None = None
    cameras_deviation: Tensor | None = None

    @property
    def numbers(self) -> list[str]:
        """Names of the views where they have no others, from 0."""
        known = self.clock if self.cameras is None else self.cameras
        return [f"view {number}" for number in range(0 if known is None else len(known))]

    def of_cameras(self, cameras: Camera) -> Camera:
        """Cameras as they stand."""
        return cameras if self.cameras is None else cameras.nudged(self.cameras)

    def of_detections(self, detections: Detections) -> Detections:
        """Detections in the time of the first view."""
        late = self.late
        return detections if late is None else at_clock(detections, late.to(detections.joints2d))

    @property
    def late(self) -> Tensor | None:
        """Frames by which each view is read later, (C,): whole ones where the clock may be whole.

        Between frames, a wrong joint spoils two of them, and the first or the last is lost.
        """
        if self.clock is None or self.clock_deviation is None:
            return self.clock
        whole = self.clock.round()
        near = (self.clock - whole).abs() <= self.clock_deviation.clamp(max=_WHOLE)
        return torch.where(near, whole, self.clock)

    def lag(self, clip: range, counts: Sequence[int]) -> Tensor | None:
        """Frames by which the images nearest to ``late`` are later than the motion, (F, C).

        NaN where a view has no such image; None where each has the very one.

        Args:
            clip: its frames in the files.
            counts: of all frames in the file of each view.
        """
        if self.late is None:
            return None
        whole = self.late.round()
        index = torch.tensor(clip).to(whole)[:, None] + whole
        there = (index >= 0) & (index < torch.tensor(counts).to(whole))
        lag = torch.where(there, whole - self.late, torch.nan)
        return None if bool((lag == 0).all()) else lag

    def report(self, names: list[str]) -> dict[str, Any]:
        """Plain values by view."""
        found: dict[str, Any] = {}
        parts = (
            ("clock_frames", self.clock, self.clock_deviation),
            ("camera_turn_shift", self.cameras, self.cameras_deviation),
        )
        for key, values, spread in parts:
            if values is not None and spread is not None:
                pairs = zip(names, values.tolist(), spread.tolist(), strict=True)
                found[key] = {n: {"value": v, "deviation": d} for n, v, d in pairs}
        return found

    def sentences(self, names: list[str]) -> Iterator[str]:
        """What a user should know."""
        if self.clock is not None and self.clock_deviation is not None:
            pairs = zip(names, self.clock.tolist(), self.clock_deviation.tolist(), strict=True)
            shown = [f"{name} {value:+.2f} ± {sure:.2f}" for name, value, sure in pairs]
            yield f"clocks: views are later than {names[0]} by {', '.join(shown[1:])} frames"
        yield from self._lost_clocks(names)
        if self.cameras is not None:
            turn, shift = self.cameras.reshape(-1, 2, 3).unbind(-2)
            pairs = zip(names, turn.norm(dim=-1).tolist(), shift.norm(dim=-1).tolist(), strict=True)
            shown = [f"{n} {57.2958 * w:.2f}°, {1000 * s:.0f} mm" for n, w, s in pairs]
            yield f"cameras were moved by {'; '.join(shown)}"
        yield from self._large_errors(names)

    def doubts(self, names: list[str]) -> Iterator[str]:
        """Those of the sentences that speak against what was found."""
        yield from self._lost_clocks(names)
        yield from self._large_errors(names)

    def _lost_clocks(self, names: list[str]) -> Iterator[str]:
        if self.clock is not None and self.clock_deviation is not None:
            lost = self.clock_deviation > _UNKNOWN
            if bool(lost.any()):
                wrong = ", ".join(n for n, each in zip(names, lost.tolist(), strict=True) if each)
                yield (
                    f"clocks of {wrong} are not found and left as they are: nobody moves there as "
                    f"in {names[0]} within {ViewErrorConfig().reach:g} s or a third of the clip; "
                    "give videos and detections of the same take, cut to within that"
                )

    def _large_errors(self, names: list[str]) -> Iterator[str]:
        if self.cameras is not None:
            turn, shift = self.cameras.reshape(-1, 2, 3).unbind(-2)
            usual = ViewErrorConfig()
            far = (turn.norm(dim=-1) > _MUCH * usual.turn) | (
                shift.norm(dim=-1) > _MUCH * usual.shift
            )
            if bool(far.any()):
                wrong = ", ".join(
                    name for name, each in zip(names, far.tolist(), strict=True) if each
                )
                yield (
                    f"that is more than a small error of {wrong}: a lens or a place may be wrong; "
                    "look at the overlay, and calibrate again"
                )


@torch.no_grad()
def solve_views(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    rate: float,
    *,
    sync: bool = True,
    refine: bool = False,
    config: PoseConfig | None = None,
    settings: ViewErrorConfig | None = None,
    examined: bool = False,
) -> ViewErrors:
    """Find clocks and small errors of the places of cameras from a moving person.

    Bone lengths are unknown too, so that any actor will do. The first view's clock is the time of
    the motion; cameras are held by a Gaussian about where they are said to stand.

    Args:
        actor: any person's skeleton.
        cameras: C fixed views, two or more.
        detections: (F, C, 16), of one clip.
        rate: frames a second.
        sync: whether clocks are unknown.
        refine: whether the places of cameras are.
        config: of the pose.
        settings: of the search.
        examined: whether the caller looks at ``sentences``; else errors that are no small ones, as
            of a wrong lens, and clocks that are not found are warned of: cameras that were moved
            agree all the same.

    Raises:
        InputError: one view, cameras that move, or a clip too short to tell.
    """
    config, settings = config or PoseConfig(), settings or ViewErrorConfig()
    require_kinds(actor=actor, cameras=cameras, detections=detections)
    rate, detections = frame_rate(rate), detections.finite()
    _require_views(cameras, detections)
    _require_length(detections, rate, sync)
    require_matching(cameras, detections, None)
    part = liveliest(detections, settings.frames)
    some = replace(detections.frames(part), joints3d=None)
    found = ViewErrors()
    if sync:
        # at hundreds of frames a second the stretch is shorter than what shows motion
        long = liveliest(detections, max(settings.frames, least_frames(rate)))
        require_motion(detections.frames(long), rate)
        clock = _whole_frames(cameras, some, round(settings.reach * rate))
        found = replace(found, clock=clock)
    frames = FrameProblem.of(actor, cameras.to(some.joints2d), some, config)
    problem = _Problem(relaxed(frames), rate, settings)
    for _ in range(settings.rounds):
        found = problem.solved(found, sync, refine)
    found = _as_given(found)
    for line in () if examined else found.doubts(found.numbers):
        warnings.warn(f"solve_views: {line}", stacklevel=3)  # through no_grad
    return found


def _as_given(found: ViewErrors) -> ViewErrors:
    """Clocks that nothing tells are zero: views would be read from any frame else."""
    if found.clock is None or found.clock_deviation is None:
        return found
    known = found.clock_deviation <= _UNKNOWN
    return replace(found, clock=torch.where(known, found.clock, 0))


def _require_views(cameras: Camera, detections: Detections) -> None:
    if cameras.moving:
        raise InputError("cameras move; clocks and small errors are found of fixed cameras only")
    if cameras.views < 2:
        raise InputError("one view has no other to be compared with; give two or more")


def _require_length(detections: Detections, rate: float, sync: bool) -> None:
    """Clocks need a person seen to move, which takes more frames where there are more a second."""
    count, need = detections.frame_count, max(_LEAST, least_frames(rate) if sync else 0)
    if count < need:
        what = f"clocks at {rate:g} frames a second" if sync else "places of cameras"
        raise InputError(
            f"clip has {count} frames; {what} need {need} or more: give a longer part (--frames)"
        )


def _whole_frames(cameras: Camera, detections: Detections, reach: int) -> Tensor:
    """Frames by which each view is later than the first, to the nearest, (C,)."""
    views, reach = detections.views, min(reach, detections.frame_count // 3)
    clock = detections.joints2d.new_zeros(views)
    for _ in range(2 if views > 2 else 1):
        for view in range(1, views):
            tried = [clock.clone() for _ in range(2 * reach + 1)]
            for step, each in enumerate(tried):
                each[view] = step - reach
            errors = torch.stack([_disagreement(cameras, detections, each) for each in tried])
            best = int(errors.argmin())
            # whole frames at a price: nothing is moved where the views do not tell
            clock = tried[best] if errors[best] < 0.98 * errors[reach] else tried[reach]
    return clock


def _disagreement(cameras: Camera, detections: Detections, clock: Tensor) -> Tensor:
    """Median error of triangulated joints at some clocks, in units of the image plane."""
    moved = at_clock(detections, clock)
    plane = cameras.to_plane(moved.joints2d)
    return triangulate(cameras, plane, moved.confidence2d, rounds=2)[1].nanmedian()


class _Problem:
    """A stretch of a clip, and the solves of it."""

    def __init__(self, frames: FrameProblem, rate: float, settings: ViewErrorConfig) -> None:
        self.frames, self.settings = frames, settings
        views = frames.cameras.views
        held = torch.tensor([settings.turn] * 3 + [settings.shift] * 3).repeat(views)
        self.problem = UncertainProblem(frames, rate, {CAMERAS: held}, settings.steps)

    def solved(self, known: ViewErrors, sync: bool, refine: bool) -> ViewErrors:
        """One round: poses of views as corrected so far, then all unknowns together."""
        frames = self.frames
        cameras = known.of_cameras(frames.cameras)
        detections = known.of_detections(frames.detections)
        motion, _ = initialize(prepare(replace(frames, cameras=cameras, detections=detections)))
        views: dict[str, Tensor] = {}
        ends: dict[str, tuple[Tensor, Tensor]] = {}
        if sync:
            assert known.clock is not None
            clock = known.clock.to(motion.angles)
            reach = torch.full_like(clock, 2.5 * self.settings.clock)
            reach[0] = 0.0  # its clock is the time of the motion
            views[CLOCK], ends[CLOCK] = clock, (clock - reach, clock + reach)
        problem = self.problem if refine else replace(self.problem, priors={})
        if refine:
            zeros = motion.angles.new_zeros(6 * frames.cameras.views)
            views[CAMERAS] = zeros if known.cameras is None else known.cameras.flatten().to(zeros)
        state = problem.solved(motion, views, ends)
        return self._errors(problem, state)

    def _errors(self, problem: UncertainProblem, state: Motion) -> ViewErrors:
        """Values and deviations at a minimum; the first clock is known, and not among these."""
        fixed = {}
        if CLOCK in state.shared:  # as good as fixed
            spread = torch.full((len(state.shared[CLOCK]),), 1e3, dtype=torch.float64)
            spread[0] = 1e-4
            fixed[CLOCK] = spread
        spreads, found = problem.deviations(state, fixed), ViewErrors()
        if CLOCK in state.shared:
            sure = spreads[CLOCK].clone()
            sure[0] = 0.0
            found = replace(found, clock=state.shared[CLOCK], clock_deviation=sure)
        if CAMERAS in state.shared:
            values, sure = (x[CAMERAS].reshape(-1, 6) for x in (state.shared, spreads))
            found = replace(found, cameras=values, cameras_deviation=sure)
        return found
