"""Masks without heads, or without hair, are named: bodies fitted to them are too short."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest
import synthetic
import torch
from bodies import person, seen
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.doctor.mask_joints import limb_doubts
from perfcap.rigging.person_masks import PersonMasks

CROWN, NECK = LANDMARKS.index("head_top"), LANDMARKS.index("neck")

View = tuple[Camera, Detections, Tensor]


@pytest.fixture(scope="module")
def view(model: BodyModel) -> View:
    """Nine frames of somebody who turns, upright in one view."""
    return look(model, synthetic.cameras(1, size=160, distance=3.0))


def look(model: BodyModel, cameras: Camera) -> View:
    three = person(model)
    bare = replace(three, shared={})
    nine = Motion.cat([replace(bare, rotation=bare.rotation * sign) for sign in (1, -1, 0.5)])
    return cameras, *seen(model, replace(nine, shared=three.shared), cameras)


def without_top(inside: Tensor, share: float) -> Tensor:
    """Masks without so much of the person's height, in every frame."""
    cut = inside.clone()
    for mask in cut.flatten(0, 1):
        rows = mask.any(1).nonzero()
        mask[: int(rows[0] + share * (rows[-1] - rows[0]))] = False
    return cut


def said(view: View, inside: Tensor, joints: Tensor | None = None) -> str:
    _, detections, _ = view
    given = detections if joints is None else replace(detections, joints2d=joints)
    return " ".join(limb_doubts(["v"], given.frames(slice(len(inside))), inside))


def test_heads_that_are_cut_off_are_named(view: View) -> None:
    whole = view[2]
    assert said(view, whole) == ""
    assert "masks of v: leave out the head; expected all" in said(view, without_top(whole, 0.13))
    assert "leave out the top of the head;" in said(view, without_top(whole, 0.05))
    assert "the top of the head;" in said(view, without_top(whole, 0.035))
    assert "the head, r_ankle" in said(view, without_top(whole, 0.13) & ~without_top(whole, 0.9))
    small = PersonMasks(view[0], whole.double()).shrunk(2)
    halves = replace(view[1], joints2d=(view[1].joints2d - 0.5) / 2)
    assert not list(limb_doubts(["v"], halves, small.inside))


def test_few_frames_say_nothing_of_hair(view: View) -> None:
    for count, share, expected in ((3, 0.13, ""), (4, 0.13, "the head"), (7, 0.03, "")):
        told = said(view, without_top(view[2], share)[:count])
        assert (expected in told) if expected else not told, (count, told)


def far_crowns(joints: Tensor) -> Tensor:
    """Crowns that a network sees a little too high."""
    wrong = joints.clone()
    wrong[..., CROWN, :] += 0.1 * (joints[..., CROWN, :] - joints[..., NECK, :])
    return wrong


def lost(joints: Tensor) -> Tensor:
    """Crowns of some frames that are somewhere else, and some that are missing."""
    wrong = joints.clone()
    wrong[:3, :, CROWN, 0] += 30
    wrong[4, :, CROWN] = torch.nan
    return wrong


def of_another(joints: Tensor) -> Tensor:
    """All joints of some frames on somebody beside."""
    wrong = joints.clone()
    wrong[:4] += torch.tensor([60.0, 0.0]).to(joints)
    return wrong


@pytest.mark.parametrize("change", [far_crowns, lost, of_another])
def test_errors_of_crowns_are_no_fault_of_masks(view: View, change: object) -> None:
    assert callable(change)
    joints = change(view[1].joints2d)
    assert said(view, view[2], joints) == ""
    assert "the head" in said(view, without_top(view[2], 0.13), joints)


def test_a_head_hidden_for_a_while_or_out_of_the_image_is_none_cut_off(view: View) -> None:
    half = torch.cat((without_top(view[2][:4], 0.2), view[2][4:]))
    assert said(view, half) == ""
    top = int(view[1].joints2d[..., CROWN, 1].amax()) + 3  # where the image begins
    above = view[1].joints2d - torch.tensor([0.0, top]).to(view[1].joints2d)
    assert said(view, view[2][..., top:, :], above) == ""


@pytest.mark.parametrize("tilt", [0.8, 1.3, torch.pi / 2])
def test_whoever_is_seen_from_above_has_a_head(model: BodyModel, tilt: float) -> None:
    assert not list(from_above(model, tilt))


def from_above(model: BodyModel, tilt: float) -> Iterator[str]:
    """What is said of the right masks of a camera that looks down so steeply."""
    cameras = synthetic.cameras(1, size=160, distance=3.0)
    motion = person(model)
    four = Motion.cat([replace(motion, shared={})] * 2)
    turn = torch.tensor([tilt, 0.0, 0.0]).to(four.rotation)
    leaning = replace(four, rotation=turn.expand_as(four.rotation), shared=motion.shared)
    detections, inside = seen(model, leaning, cameras)
    return limb_doubts(["v"], detections, inside)


def test_shoes_that_are_cut_off_are_named(view: View) -> None:
    """Toes of right masks lie at their edges, and a single one may lie outside."""
    _, detections, inside = view
    bare = inside.clone()
    rows, columns = torch.meshgrid(*map(torch.arange, inside.shape[-2:]), indexing="ij")
    pixels = torch.stack((columns, rows), -1).to(detections.joints2d)
    for side in "lr":
        ankle, toe = (
            detections.joints2d[..., LANDMARKS.index(f"{side}_{end}"), :]
            for end in ("ankle", "toe")
        )
        reach = 0.8 * (toe - ankle).norm(dim=-1)  # about the toe, short of the ankle
        bare &= (pixels - toe[..., None, None, :]).norm(dim=-1) > reach[..., None, None]
    assert "leave out the shoes; expected all" in said(view, bare)
    beside = detections.joints2d.clone()
    beside[..., LANDMARKS.index("l_toe"), 0] += 25  # one toe, whatever the mask
    assert said(view, inside, beside) == ""
    assert list(limb_doubts(["v"], detections, inside)) == []
