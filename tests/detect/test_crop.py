"""Crops and the way back."""

import numpy as np
import pytest
import torch

from perfcap.detect.crop import Crop, body_box, next_crop

CROP = Crop((61.5, 40.25), 48.0, (128, 96))
TURNED = Crop((61.5, 40.25), 48.0, (128, 96), 0.7)


@pytest.mark.parametrize("crop", [CROP, TURNED], ids=["upright", "turned"])
def test_to_image_undoes_from_image(crop: Crop) -> None:
    points = torch.randn(50, 2, dtype=torch.float64) * 100
    torch.testing.assert_close(crop.to_image(crop.from_image(points)), points)
    matrix = crop.matrix(points)
    torch.testing.assert_close(points @ matrix[:, :2].T + matrix[:, 2], crop.to_image(points))


def test_a_turned_crop_shows_somebody_on_the_side_upright() -> None:
    """Its way up is the image's way right at a quarter turn, and 3D vectors turn with it."""
    crop = Crop((50.0, 50.0), 64.0, (64, 64), 0.5 * np.pi)
    low, high = torch.tensor([[31.5, 61.5], [31.5, 1.5]], dtype=torch.float64)
    up = crop.to_image(high) - crop.to_image(low)
    torch.testing.assert_close(up, torch.tensor([60.0, 0.0], dtype=torch.float64))
    turned = crop.turn(low) @ torch.tensor([0.0, -60.0, 5.0], dtype=torch.float64)
    torch.testing.assert_close(turned, torch.tensor([60.0, 0.0, 5.0], dtype=torch.float64))


def test_the_middle_is_the_middle_with_pixel_centres_at_integers() -> None:
    middle = torch.tensor([47.5, 63.5], dtype=torch.float64)
    torch.testing.assert_close(CROP.to_image(middle), torch.tensor(CROP.center).double())
    whole = Crop.around((-0.5, -0.5, 95.5, 127.5), (128, 96))
    corner = torch.zeros(2, dtype=torch.float64)
    torch.testing.assert_close(whole.to_image(corner), corner)


@pytest.mark.parametrize(("width", "angle"), [(30.0, 0.0), (96.0, 0.0), (96.0, 1.9), (150.0, 0.0)])
def test_what_is_cut_lies_where_the_map_says(width: float, angle: float) -> None:
    """A smooth ramp sampled by the crop has the value of its place in the image."""
    y, x = np.mgrid[:200, :200]
    frame = np.stack((x, y, np.zeros_like(x)), -1).astype(np.uint8)
    crop = Crop((100.0, 90.0), width, (40, 30), angle)
    part = crop.cut(frame)
    v, u = np.mgrid[:40, :30]
    places = crop.to_image(torch.tensor(np.stack((u, v), -1).reshape(-1, 2), dtype=torch.float64))
    found = part[..., :2].reshape(-1, 2)
    inside = ((places > 1) & (places < 198)).all(-1).numpy()
    assert np.abs(found - places.numpy())[inside].max() <= 0.6  # rounded to bytes


def test_outside_the_image_is_black() -> None:
    frame = np.full((20, 20, 3), 200, np.uint8)
    part = Crop((0.0, 0.0), 40.0, (32, 32)).cut(frame)
    assert (part[:15, :15] == 0).all() and (part[20:30, 20:30] == 200).all()


def test_around_holds_the_box_in_the_shape_of_the_input() -> None:
    for box in ((10, 20, 30, 100), (10, 20, 130, 40), (5, 5, 5, 5)):
        crop = Crop.around(box, (128, 96), 1.25)
        assert crop.center == (0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]))
        assert crop.width >= 1.25 * (box[2] - box[0]) and crop.height >= 1.25 * (box[3] - box[1])
        assert crop.height / crop.width == pytest.approx(128 / 96)


def test_a_body_needs_joints() -> None:
    joints = torch.rand(16, 2) * 100
    confidence = torch.zeros(16)
    confidence[:3] = 1
    assert body_box(joints, confidence, 0.3) is None
    assert next_crop(CROP, joints, confidence, 0.3, 1.25) is None
    confidence[:4] = 1
    box = body_box(joints, confidence, 0.3)
    assert box is not None
    low, high = joints[:4].amin(0), joints[:4].amax(0)
    assert box[0] < low[0] and box[1] < low[1] and box[2] > high[0] and box[3] > high[1]


def test_crops_grow_at_once_and_shrink_slowly() -> None:
    joints = torch.tensor([[0.0, 0], [10, 0], [0, 20], [10, 20]])
    sure = torch.ones(4)
    small = next_crop(CROP, joints, sure, 0.3, 1.25)
    assert small is not None and small.width == pytest.approx(0.9 * CROP.width)
    large = next_crop(CROP, 50 * joints, sure, 0.3, 1.25)
    assert large is not None and large.width > 500
    widths = []
    for missing in (1, 4, 8):
        points = torch.cat((50 * joints, joints[:1].expand(missing, 2)))
        confidence = torch.tensor([1.0] * 4 + [0.0] * missing)
        unsure = next_crop(CROP, points, confidence, 0.3, 1.25)
        assert unsure is not None
        widths.append(unsure.width / large.width)
    assert widths == pytest.approx([1 + 0.15 / 4, 1.15, 1.15])
