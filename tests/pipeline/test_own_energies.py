"""An author's own energy in a capture and in a layer."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.energy import PosePrior
from perfcap.errors import InputError
from perfcap.pipeline import PoseRefiner, capture
from perfcap.pipeline.clip_problem import FrameNumbers
from perfcap.pipeline.config import EvidenceConfig, PoseConfig
from perfcap.pipeline.stage import Stage
from perfcap.solve import Energy, Residual

WRIST = LANDMARKS.index("l_wrist")
HELD = range(3, 7)
F64 = torch.float64


class Holds(Energy[Motion]):
    """A wrist is at a place in some frames of one clip."""

    def __init__(self, actor: Actor, where: FrameNumbers, place: Tensor, clip: int = 0) -> None:
        super().__init__(weight=1e6)
        self.actor, self.place = actor, place
        inside = (where.frames >= HELD.start) & (where.frames < HELD.stop)
        self.on = (inside & (where.clips == clip)[..., None]).to(place).unsqueeze(-1)

    def residual(self, motion: Motion) -> Residual:
        away = self.actor.joints(motion)[..., WRIST : WRIST + 1, :] - self.place
        return Residual(away, self.on)


def held_at(place: Tensor, clip: int = 0) -> Callable[[Actor, FrameNumbers], Energy[Motion]]:
    return lambda actor, where: Holds(actor, where, place, clip)


@pytest.mark.long
def test_a_capture_follows_it_where_it_acts() -> None:
    take = make_take(60)
    parts = take.actor, take.cameras, take.detections, take.rate
    plain = capture(*parts)
    place = plain.joints()[HELD.start : HELD.stop, WRIST].mean(0) + 0.05
    found = capture(*parts, energies={"holds": held_at(place)})
    before, after = (
        (each.joints()[HELD.start : HELD.stop, WRIST] - place).norm(dim=-1).max()
        for each in (plain, found)
    )
    assert before > 0.05 and after < 0.005
    # far from these frames nothing changes
    torch.testing.assert_close(found.joints()[45:], plain.joints()[45:], rtol=0, atol=2e-3)
    share = found.report()["energy"]["holds"]
    assert [f for f, value in enumerate(share) if value > 0] == list(HELD)
    assert "holds" in found.report()["windows"][0]["terms"]


@pytest.mark.long
def test_a_layer_knows_which_clip_is_meant() -> None:
    take = make_take(10)
    layer = PoseRefiner(take.actor).eval()
    pixels = [take.detections.joints2d, take.detections.joints2d.clone()]
    plain = layer(take.cameras, pixels)
    place = plain.joints[0, HELD.start : HELD.stop, WRIST].mean(0) + 0.05
    own = PoseRefiner(take.actor, energies={"holds": held_at(place, clip=1)}).eval()
    found = own(take.cameras, pixels)
    torch.testing.assert_close(found.joints[0], plain.joints[0], rtol=0, atol=1e-9)
    off = (found.joints[1, HELD.start : HELD.stop, WRIST] - place).norm(dim=-1)
    assert off.max() < 0.005


@pytest.mark.slow
def test_gradients_reach_what_it_is_made_of() -> None:
    take = make_take(10)
    once = PoseConfig(evidence=EvidenceConfig(enabled=False), max_steps=200, tolerance=1e-12)
    place = torch.tensor([0.3, 1.2, 0.2], dtype=F64, requires_grad=True)
    weights = torch.randn(10, 16, 3, generator=torch.Generator().manual_seed(0), dtype=F64)

    def value(at: Tensor) -> Tensor:
        layer = PoseRefiner(take.actor, config=once, energies={"holds": soft(at)})
        return (layer(take.cameras, take.detections.joints2d).joints * weights).sum()

    def soft(at: Tensor) -> Callable[[Actor, FrameNumbers], Energy[Motion]]:
        def make(actor: Actor, where: FrameNumbers) -> Energy[Motion]:
            energy = Holds(actor, where, at)
            energy.weight.fill_(100.0)
            return energy

        return make

    (gradient,) = torch.autograd.grad(value(place), place)
    step = 1e-3 * torch.tensor([0.6, 0.0, -0.8], dtype=F64)
    with torch.no_grad():
        slope = (value(place + step) - value(place - step)) / 2
    assert float((gradient * step).sum()) == pytest.approx(float(slope), rel=2e-3)


def test_names_that_are_taken_and_energies_already_made_are_refused() -> None:
    take = make_take(4)
    parts = take.actor, take.cameras, take.detections, take.rate
    with pytest.raises(InputError, match="'prior' is one of joints2d"):
        capture(*parts, energies={"prior": held_at(torch.zeros(3))})
    made = PosePrior(take.actor.skeleton.lower)
    with pytest.raises(InputError, match=r"expected a function of \(actor, where\)"):
        PoseRefiner(take.actor, energies={"mine": made})  # type: ignore[dict-item]


@pytest.mark.long
def test_targets_in_other_axes_are_said() -> None:
    """Places from a camera, for those in the world: the person follows, and leaves the joints."""
    take = make_take(12)
    parts = take.actor, take.cameras, take.detections, take.rate
    place = capture(*parts).joints()[HELD.start : HELD.stop, WRIST].mean(0)
    local = take.cameras.to_camera(place[None, None])[0, 0, 0]
    said = "check axes, unit and frames of what your own energies want"
    for wanted, wrong in ((place, False), (local, True)):
        every = lambda actor, where, at=wanted: Stays(actor, at)  # noqa: E731
        found = capture(*parts, energies={"stays": every}).warnings
        assert any(said in line for line in found) is wrong


class Stays(Energy[Motion]):
    """A wrist is at a place throughout."""

    def __init__(self, actor: Actor, place: Tensor) -> None:
        super().__init__(weight=1e4)
        self.actor, self.place = actor, place

    def residual(self, motion: Motion) -> Residual:
        return Residual(self.actor.joints(motion)[..., WRIST : WRIST + 1, :] - self.place)


@pytest.mark.long
def test_one_without_frames_to_act_in_changes_nothing() -> None:
    take = make_take(12)
    parts = take.actor, take.cameras, take.detections, take.rate
    found = capture(*parts, energies={"holds": held_at(torch.zeros(3, dtype=F64), 1)})
    assert torch.equal(found.motion.angles, capture(*parts).motion.angles)


@pytest.mark.long
def test_a_constant_motion_may_be_posed_in_a_residual() -> None:
    """Compiled loops keep out of transforms, where what they make has no memory."""
    take = make_take(12)
    parts = take.actor, take.cameras, take.detections, take.rate
    fixed = capture(*parts).motion

    class Rests(Holds):
        def residual(self, motion: Motion) -> Residual:
            apart = self.actor.joints(motion) - self.actor.joints(fixed)
            return Residual(apart[..., WRIST : WRIST + 1, :], self.on)

    place = torch.zeros(3, dtype=F64)
    assert capture(*parts, energies={"rests": lambda a, w: Rests(a, w, place)}).complete


def test_one_that_has_no_window_to_act_in_is_refused() -> None:
    take = make_take(6)
    parts = take.actor, take.cameras, take.detections, take.rate
    with pytest.raises(InputError, match="energies holds act in the windows of track_motion"):
        capture(
            *parts,
            until=Stage.INITIALIZE,
            energies={"holds": held_at(torch.zeros(3, dtype=F64))},
        )


class Differs(Energy[Motion]):
    """Two angles are equal, which moving all of them alike does not change."""

    def residual(self, motion: Motion) -> Residual:
        return Residual(motion.angles[..., None, 3:4] - motion.angles[..., None, 4:5] + 0.1)


class Detached(Differs):
    def residual(self, motion: Motion) -> Residual:
        return Residual(super().residual(motion).value.detach())


@pytest.mark.long
def test_one_that_does_not_follow_the_motion_is_named() -> None:
    take = make_take(6)
    parts = take.actor, take.cameras, take.detections, take.rate
    capture(*parts, energies={"equal": lambda actor, where: Differs(0.1)})
    with pytest.warns(UserWarning, match="energy 'equal' does not change with its unknowns"):
        capture(*parts, energies={"equal": lambda actor, where: Detached(0.1)})


class Lost(Differs):
    def residual(self, motion: Motion) -> Residual:
        value = super().residual(motion).value
        return Residual(
            torch.where(torch.arange(value.shape[-3])[:, None, None] > 3, value, torch.nan)
        )


def test_clips_that_are_not_solved_are_named() -> None:
    """Their motion was where it started, and carried no gradient."""
    take = make_take(10)
    pixels = torch.stack([take.detections.joints2d, take.detections.joints2d])
    with pytest.warns(UserWarning, match="clips 0-1 were not solved everywhere: a window met a"):
        found = PoseRefiner(take.actor, energies={"lost": lambda a, w: Lost(0.1)}).eval()(
            take.cameras, pixels
        )
    assert found.status.tolist() == [3, 3]


def test_rows_that_see_other_frames_are_refused() -> None:
    take = make_take(12)

    class Smooth(Holds):
        def residual(self, motion: Motion) -> Residual:
            step = motion.translation.diff(dim=-2, append=motion.translation[..., -1:, :])
            return Residual(step.unsqueeze(-2))

    with pytest.raises(InputError, match="energy 'smooth' has rows that depend on other frames"):
        capture(
            *(take.actor, take.cameras, take.detections, take.rate),
            energies={"smooth": lambda a, w: Smooth(a, w, torch.zeros(3, dtype=F64))},
        )


@pytest.mark.parametrize(
    ("energies", "message"),
    [
        ([Holds], "energies are a list"),
        (Holds, "energies are a ABCMeta"),
        ({"own": lambda a, w: None}, "'own' made a NoneType"),
        ({"own": lambda a, w: torch.nn.Linear(1, 1)}, "'own' made a Linear"),
        ({3: held_at(torch.zeros(3, dtype=F64))}, "3 cannot name an energy"),
        ({"a.b": held_at(torch.zeros(3, dtype=F64))}, "'a.b' cannot name an energy"),
    ],
)
def test_terms_that_are_none_are_named(energies, message) -> None:  # type: ignore[no-untyped-def]
    take = make_take(6)
    with pytest.raises(InputError, match=message):
        capture(take.actor, take.cameras, take.detections, take.rate, energies=energies)


class Targets(Energy[Motion]):
    """Places of a wrist that are held for every frame of a clip."""

    def __init__(self, actor: Actor, where: FrameNumbers, places: Tensor, right: bool) -> None:
        super().__init__(weight=100.0)
        self.actor, self.where, self.places, self.right = actor, where, places, right

    def residual(self, motion: Motion) -> Residual:
        wanted = self.places[self.where.frames if self.right else slice(motion.frames)]
        return Residual(self.actor.joints(motion)[..., WRIST : WRIST + 1, :] - wanted)


@pytest.mark.parametrize("right", [True, False])
def test_targets_of_the_first_window_in_every_one_are_named(right: bool) -> None:
    """The last frames followed the first ones' targets, without a word."""
    take, quick = make_take(16), PoseConfig(window=10, overlap=4)
    places = take.actor.joints(take.truth)[:, WRIST : WRIST + 1].detach()
    own = {"wrist": lambda actor, where: Targets(actor, where, places, right)}
    layer = PoseRefiner(take.actor, rate=take.rate, config=quick, energies=own)
    views, joints = take.cameras, take.detections.joints2d
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        layer(views, joints, take.detections.confidence2d, take.detections.joints3d)
    lines = [str(each.message) for each in said if "energy 'wrist'" in str(each.message)]
    assert bool(lines) != right
    for line in lines:
        assert "in the window from frame 0" in line and "where.frames" in line


def test_errors_of_torch_say_which_frames_they_are_of() -> None:
    take, quick = make_take(16), PoseConfig(window=10, overlap=4)
    places = torch.zeros(16, 1, 3, dtype=F64)

    class Whole(Targets):
        def residual(self, motion: Motion) -> Residual:
            return Residual(self.actor.joints(motion)[..., WRIST : WRIST + 1, :] - self.places)

    own = {"wrist": lambda actor, where: Whole(actor, where, places, True)}
    layer = PoseRefiner(take.actor, rate=take.rate, config=quick, energies=own)
    with pytest.raises(RuntimeError) as found:
        layer(take.cameras, take.detections.joints2d)
    assert any("wrist" in note and "0 to 9" in note for note in found.value.__notes__)
