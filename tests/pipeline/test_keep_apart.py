"""Two people side by side, whose hands and arms pass through each other in the middle of a clip."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

import perfcap
from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.metrics import skin_gap
from perfcap.pipeline.keep_apart import ApartConfig, keep_apart
from perfcap.render.projected_mesh import vertex_normals

GAPS = (0.75, 0.6, 0.51, 0.49, 0.51, 0.6)  # m between the people, by frame
TOUCHING = (2, 3, 4)


@pytest.fixture(scope="module")
def sam() -> Actor:
    return perfcap.load_actor("sam")


def beside(actor: Actor, gaps: tuple[float, ...] = GAPS, behind: float = 0.0) -> list[Motion]:
    """Two people whose arms hang, the second so far to the left of the first."""
    like, frames = actor.vertices, len(gaps)
    still, angles = like.new_zeros(frames, 3), like.new_zeros(frames, 33 - 6)
    left = torch.stack([like.new_tensor((gap, 0.0, behind)) for gap in gaps])
    return [Motion(still, still, angles), Motion(left, still, angles)]


def gap(actor: Actor, motions: list[Motion], frame: int) -> float:
    """Between both skins, m; below zero in each other."""
    faces = torch.as_tensor(actor.template.faces.copy())
    skins = [actor.surface(motion[frame : frame + 1])[0].double() for motion in motions]
    one, other = ((skin.numpy(), vertex_normals(skin, faces).numpy()) for skin in skins)
    return skin_gap(one, other)


def moved(actor: Actor, one: Motion, other: Motion) -> Tensor:
    """How far the worst joint of each frame is moved, (F,), m."""
    return (actor.joints(one) - actor.joints(other)).norm(dim=-1).amax(-1)


@pytest.mark.long
def test_they_touch_and_do_not_pass(sam: Actor) -> None:
    given = beside(sam)
    found = list(keep_apart([sam, sam], given, ApartConfig()))
    for frame in TOUCHING:
        before, after = gap(sam, given, frame), gap(sam, found, frame)
        assert before < -0.005 and -0.005 <= after < 0.01, frame
    for old, new in zip(given, found, strict=True):
        far = moved(sam, old, new)
        assert (far[list(TOUCHING)] > 1e-3).all() and far.max() < 0.06  # both give way, a little
        for frame in (0, 1, 5):
            assert torch.equal(new.angles[frame], old.angles[frame]) and far[frame] == 0


@pytest.mark.long
def test_who_is_named_first_does_not_matter(sam: Actor) -> None:
    given = beside(sam)
    one = keep_apart([sam, sam], given, ApartConfig())
    other = keep_apart([sam, sam], given[::-1], ApartConfig())
    for a, b in zip(one, reversed(other), strict=True):
        assert moved(sam, a, b).max() < 2e-3


def test_what_needs_nothing_is_the_same_object(sam: Actor) -> None:
    for given, config in (
        (beside(sam, (0.75, 1.5)), ApartConfig()),
        (beside(sam), ApartConfig(enabled=False)),
        (beside(sam), ApartConfig(tolerance=0.2)),
    ):
        found = keep_apart([sam, sam], given, config)
        assert all(a is b for a, b in zip(found, given, strict=True))


@pytest.mark.long
def test_one_in_the_middle_of_another_stays(sam: Actor) -> None:
    """Nothing says to which side they belong; half a body is no contact."""
    given = beside(sam, (0.12,), behind=0.03)
    for old, new in zip(given, keep_apart([sam, sam], given, ApartConfig()), strict=True):
        assert torch.equal(old.translation, new.translation)


@pytest.mark.long
def test_three_people(sam: Actor) -> None:
    first, second = beside(sam)
    third = replace(second, translation=2 * second.translation)
    found = list(keep_apart([sam] * 3, [first, second, third], ApartConfig()))
    for frame in TOUCHING:
        assert min(gap(sam, found[:2], frame), gap(sam, found[1:], frame)) >= -0.005


def test_a_brush_of_skins_stays(sam: Actor) -> None:
    """Less than the tolerance, in a stretch of its own."""
    given = beside(sam, (0.515, 0.75, 0.49))
    assert -0.005 < gap(sam, given, 0) < 0
    found = keep_apart([sam, sam], given, ApartConfig())
    for old, new in zip(given, found, strict=True):
        far = moved(sam, old, new)
        assert far[0] == 0 and far[2] > 1e-3


@pytest.mark.long
def test_deep_ones_are_led_out_step_by_step(sam: Actor) -> None:
    """A hand through a hand, and no joint is thrown far out."""
    given = beside(sam, (0.46,))
    assert gap(sam, given, 0) < -0.05
    found = list(keep_apart([sam, sam], given, ApartConfig()))
    assert gap(sam, found, 0) >= -0.005
    assert all(moved(sam, *pair).max() < 0.05 for pair in zip(given, found, strict=True))
