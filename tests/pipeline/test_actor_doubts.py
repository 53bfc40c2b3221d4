"""Actors of another size than the person that the views show."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from synthetic import rest_positions, template
from takes import make_take

from perfcap.actor.actor import Actor
from perfcap.pipeline.bone_doubts import bone_ratios
from perfcap.pipeline.input_doubts import actor_doubts
from perfcap.pipeline.jobs import capture


def everywhere(actor: Actor, value: float) -> torch.Tensor:
    return torch.full((len(actor.skeleton.group_names),), value, dtype=torch.float64)


def test_the_right_actor_is_not_spoken_of() -> None:
    take = make_take(20, views=3)
    assert not list(actor_doubts(take.actor, take.cameras, take.detections, False))


def test_an_actor_of_another_size_is_told() -> None:
    take = make_take(20, views=3)
    with pytest.warns(UserWarning, match="these look like the factors"):
        large = take.actor.resized(everywhere(take.actor, 1.1))
    (told,) = actor_doubts(large, take.cameras, take.detections, False)
    assert "m tall" in told and "metres" in told
    longer = take.actor.resized(everywhere(take.actor, 0.4))
    (told,) = actor_doubts(longer, take.cameras, take.detections, False)
    assert "--bones solve" in told
    assert not list(actor_doubts(longer, take.cameras, take.detections, True))


@pytest.mark.parametrize(
    ("joint", "towards", "share", "words"),
    [
        ("elbow", "shoulder", 0.4, "upper arms 0.60, forearms 1."),
        ("shoulder", "elbow", 0.35, "upper arms 0.65 times"),
        ("knee", "hip", 0.3, "thighs 0.70, shanks 1."),
    ],
)
def test_joints_at_wrong_places_on_both_sides_are_told(
    joint: str, towards: str, share: float, words: str
) -> None:
    take = make_take(20, views=3)
    at = rest_positions()
    for side in "lr":
        own, other = f"{side}_{joint}", f"{side}_{towards}"
        at[own] = at[own] + share * (at[other] - at[own])
    wrong = Actor(template(at))
    (told,) = actor_doubts(wrong, take.cameras, take.detections, False)
    assert words in told and "perfcap actor inspect" in told
    assert not list(actor_doubts(wrong, take.cameras, take.detections, True))
    assert not list(
        actor_doubts(wrong, take.cameras.select([0]), take.detections.select([0]), False)
    )


def test_a_template_of_ones_own_with_left_for_right_is_told() -> None:
    """Also in one view, and where bones are solved."""
    take = make_take(8)
    at = rest_positions()
    sides = {"l": "r", "r": "l"}
    crossed = {sides.get(n[0], n[0]) + n[1:] if n[1] == "_" else n: p for n, p in at.items()}
    crossed |= {name: at[name] for name in ("l_toe", "r_toe")}
    wrong = Actor(template(crossed))
    told = list(actor_doubts(wrong, take.cameras, take.detections, True))
    assert any("left are on the right of where the feet point" in line for line in told)


def test_feet_of_another_length_are_told() -> None:
    take = make_take(20, views=3)
    at = rest_positions()
    for side in "lr":
        at[f"{side}_toe"] = at[f"{side}_toe"] + torch.tensor([0.0, 0.0, 0.12]).double()
    (told,) = actor_doubts(Actor(template(at)), take.cameras, take.detections, False)
    assert "(feet 1." in told


def test_bones_that_are_hardly_seen_say_nothing() -> None:
    take = make_take(20, views=3)
    places = take.actor.joints(take.truth)
    assert bone_ratios(take.actor, places) == pytest.approx(
        dict.fromkeys(("upper arms", "forearms", "thighs", "shanks", "feet"), 1.0)
    )
    places[3:] = torch.nan
    assert not bone_ratios(take.actor, places)


def test_half_a_grown_person_in_one_view_is_told() -> None:
    """The person would be at half the distance, and nothing else would show it."""
    take = make_take(8)
    assert not list(actor_doubts(take.actor, take.cameras, take.detections, False))
    half = take.actor.resized(everywhere(take.actor, math.log(0.5)))
    (told,) = actor_doubts(half, take.cameras, take.detections, False)
    assert "a grown person 1.2 to 2.3" in told and "distances" in told


def test_views_that_show_no_legs_say_nothing_of_their_length() -> None:
    take = make_take(20, views=3)
    unseen = torch.zeros_like(take.detections.confidence2d)
    nobody = replace(take.detections, confidence2d=unseen)
    assert not list(actor_doubts(take.actor, take.cameras, nobody, False))
    origin = torch.zeros(20, 16, 3, dtype=torch.float64)  # all joints in one place
    point = replace(take.detections, joints2d=take.cameras.project(origin))
    assert not list(actor_doubts(take.actor, take.cameras, point, False))


def test_focal_lengths_that_are_too_long_in_every_view_are_told_in_python() -> None:
    take = make_take(20, views=3)
    longer = take.cameras.intrinsics.clone()
    longer[:, [0, 1], [0, 1]] *= 1.3
    found = capture(
        take.actor, replace(take.cameras, intrinsics=longer), take.detections, take.rate
    )
    assert any("focal lengths of the calibration" in line for line in found.warnings)


def test_an_actor_without_a_surface_is_captured() -> None:
    """As where somebody has a skeleton alone."""
    take = make_take(8)

    class Bare(Actor):
        def __init__(self) -> None:
            torch.nn.Module.__init__(self)
            self.skeleton = take.actor.skeleton

    assert not list(actor_doubts(Bare(), take.cameras, take.detections, False))
