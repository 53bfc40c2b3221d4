"""Angles, contacts, image thresholds: known values and invariances."""

from __future__ import annotations

import math

import pytest
import torch

from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.metrics import (
    angle_error,
    bone_angle_error,
    floor_contact,
    foot_skate,
    girth_errors,
    head_size,
    image_correct_share,
    penetration,
    torso_size,
)

F64 = torch.float64
UP = torch.tensor([0.0, 1.0, 0.0], dtype=F64)


def test_angles_are_compared_on_the_circle() -> None:
    truth = torch.tensor([[math.pi - 0.1, 0.0]], dtype=F64)
    angles = torch.tensor([[-math.pi + 0.1, torch.nan]], dtype=F64)
    torch.testing.assert_close(angle_error(angles, truth), truth.new_tensor(math.degrees(0.2)))
    with pytest.raises(InputError, match="same rig"):
        angle_error(angles, truth[:, :1])


@pytest.mark.parametrize("degrees", [0.0, 1e-4, 30.0, 90.0, 180.0])
def test_bone_angles_are_exact_everywhere(degrees: float) -> None:
    """Also where an arccos loses its digits; whatever the length and the place."""
    turn = rotvec_to_matrix(torch.tensor([0.0, 0.0, math.radians(degrees)], dtype=F64))
    truth = torch.tensor([[[0.0, 0, 0], [1, 0, 0]]], dtype=F64)
    found = 3 * truth @ turn.mT + 7
    expected = truth.new_tensor(degrees)
    torch.testing.assert_close(
        bone_angle_error(found, truth, [(0, 1)]), expected, atol=1e-9, rtol=1e-9
    )


def test_bones_without_length_do_not_count() -> None:
    truth = torch.zeros(2, 3, 3, dtype=F64)
    truth[:, 1, 0] = 1
    assert bone_angle_error(truth, truth, [(0, 1), (0, 2)]) == 0


def test_standing_feet_that_slide() -> None:
    """One foot stands and slides 2 mm a frame, the other is in the air and moves a lot."""
    time = torch.arange(20, dtype=F64)
    truth = torch.zeros(20, 2, 3, dtype=F64)
    truth[:, 0, 1] = 0.09  # an ankle
    truth[1:, 1, 1], truth[:, 1, 0] = 0.5, 0.1 * time
    contact = floor_contact(truth, truth[..., 1], 30.0)
    assert contact[:, 0].all() and not contact[:, 1].any()
    sliding = truth.clone()
    sliding[:, 0, 2] = 0.002 * time
    sliding[:, 0, 1] += 0.01 * time  # up is no slide
    torch.testing.assert_close(foot_skate(sliding, contact, UP), sliding.new_tensor(2.0))
    assert foot_skate(sliding, torch.zeros_like(contact), UP).isnan()
    with pytest.raises(InputError, match="contact"):
        foot_skate(sliding, contact[1:], UP)
    with pytest.raises(InputError, match="fps is 0"):
        floor_contact(truth, truth[..., 1], 0.0)
    for feet, height in ((truth[1:], truth[..., 1]), (truth[..., :2], truth[..., 1])):
        with pytest.raises(InputError, match="feet have shape"):
            floor_contact(feet, height, 30.0)
    with pytest.raises(InputError, match="feet have shape"):
        floor_contact(truth[0], truth[0, :, 1], 30.0)


def test_penetration() -> None:
    height = torch.tensor([[0.1, 0.2], [-0.01, 0.3], [-0.003, 0.0], [torch.nan, 0]], dtype=F64)
    found = penetration(height)
    torch.testing.assert_close(found.depth, height.new_tensor(13 / 3))
    torch.testing.assert_close(found.worst, height.new_tensor(10.0))
    torch.testing.assert_close(found.share, height.new_tensor(100 / 3))
    batch = penetration(torch.stack((height, height + 1)))
    assert batch.depth[1] == 0 and batch.depth[0] == found.depth


def test_image_shares_scale_with_the_person() -> None:
    truth = torch.zeros(3, 16, 2, dtype=F64)
    truth[:, 5], truth[:, 8] = torch.tensor([30.0, 0.0]), torch.tensor([0.0, 40.0])
    truth[:, 0] = torch.tensor([0.0, -10.0])
    assert (torso_size(truth) == 50).all() and (head_size(truth) == 10).all()
    pixels = truth.clone()
    pixels[..., 0] += 9.99
    assert image_correct_share(pixels, truth, torso_size(truth), 0.2) == 100
    assert image_correct_share(pixels, truth, head_size(truth), 0.5) == 0
    assert image_correct_share(3 * pixels, 3 * truth, 3 * torso_size(truth), 0.2) == 100
    pixels[:, 3] += 100
    found = image_correct_share(pixels, truth, torso_size(truth), 0.2)
    torch.testing.assert_close(found, found.new_tensor(100 * 15 / 16))


def test_image_shares_leave_out_what_is_missing() -> None:
    truth = torch.ones(2, 16, 2, dtype=F64)
    pixels = truth.clone()
    pixels[0, 0], pixels[1, 1] = torch.nan, 1e3
    confidence = torch.ones(2, 16, dtype=F64)
    confidence[1, 1] = 0
    size = torch.tensor([10.0, 10.0], dtype=F64)
    assert image_correct_share(pixels, truth, size, 0.2, confidence) == 100
    assert image_correct_share(pixels, truth, torch.zeros(2, dtype=F64), 0.2).isnan()
    with pytest.raises(InputError, match="size has shape"):
        image_correct_share(pixels, truth, size[:1], 0.2)


def test_girths() -> None:
    truth = {"chest": 1.0, "waist": 0.8, "hip": 0.9}
    errors = girth_errors({"chest": 1.02, "waist": 0.76, "hip": math.nan, "neck": 0.4}, truth)
    assert errors.errors == pytest.approx({"chest": 20, "waist": 40})
    assert errors.mean == pytest.approx(30) and errors.deviation == pytest.approx(10)
    assert errors.missing == ("hip",)
    assert math.isnan(girth_errors({}, truth).mean)
    with pytest.raises(InputError, match="true chest"):
        girth_errors({}, {"chest": 0.0})
