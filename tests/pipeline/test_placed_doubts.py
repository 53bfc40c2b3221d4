"""What the layer says of 3D joints that are placed where images or other views contradict them."""

from __future__ import annotations

import warnings

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.retarget import mid_hip
from perfcap.pipeline import PoseRefiner

COUNT = 24
TAKE = make_take(COUNT, views=3)
LOCAL = TAKE.cameras.to_camera(TAKE.actor.joints(TAKE.truth))
PIXELS = TAKE.detections.joints2d
ROOT = mid_hip(LOCAL)[..., None, :]


def said(joints3d: Tensor, joints2d: Tensor | None = None, views: int = 3) -> list[str]:
    layer = PoseRefiner(TAKE.actor).eval()
    some = [each if each is None else each[:, :views] for each in (joints2d, joints3d)]
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        layer(TAKE.cameras.select([*range(views)]), some[0], joints3d=some[1], placed=True)
    return [str(each.message) for each in found]


def noisy(deviation: float) -> Tensor:
    generator = torch.Generator().manual_seed(0)
    off = torch.randn(LOCAL.shape, generator=generator, dtype=LOCAL.dtype)
    joints: Tensor = LOCAL + deviation * off
    return joints


@pytest.mark.long
@pytest.mark.parametrize("views", [1, 2, 3])
def test_right_joints_with_errors_are_not_named(views: int) -> None:
    for joints in (LOCAL, noisy(0.03)):
        assert said(joints, None, views) == []
        assert said(joints, PIXELS, views) == []


def test_views_exchanged_from_the_middle_on() -> None:
    """3D joints alone were 0.25 m off without a word."""
    joints = LOCAL.clone()
    joints[COUNT // 2 :, [0, 1]] = LOCAL[COUNT // 2 :, [1, 0]]
    (line,) = said(joints)
    assert f"view 0 and view 1: look exchanged in frames {COUNT // 2}-{COUNT - 1}" in line


@pytest.mark.long
def test_places_at_another_distance_than_lines_of_sight_have() -> None:
    """It was said that joints may be in another order, or nothing."""
    for line in said(1.06 * LOCAL):
        assert "1.06 times as far away as where lines of sight of the views meet" in line
    one = LOCAL.clone()
    one[:, 2] *= 0.9
    (line,) = said(one)
    assert "view 2: its placed 3D joints are 0.90 times as far away" in line
    (line, *_) = said(LOCAL + 0.1 * torch.sin(torch.arange(COUNT))[:, None, None, None] * ROOT)
    assert "beside where lines of sight" in line


@pytest.mark.long
@pytest.mark.parametrize("views", [1, 2])
def test_places_that_images_contradict(views: int) -> None:
    """As those of a network that has a lens of its own: one view followed them anywhere."""
    assert "are 1.25 to 1.2" in said(LOCAL - 0.2 * ROOT, PIXELS, views)[0]
    waves = 0.25 * torch.sin(torch.arange(COUNT))[:, None, None, None]
    assert "times as large" in said(LOCAL + waves * ROOT, PIXELS, views)[0]
    beside = LOCAL + LOCAL.new_tensor([0.5, 0, 0])
    assert "of the person's size beside the 2D joints" in said(beside, PIXELS, views)[0]


def test_axes_in_another_order() -> None:
    (line,) = said(LOCAL[..., [2, 0, 1]])
    assert "m apart in frames" in line


def test_joints_of_the_world_in_several_views() -> None:
    world = LOCAL[:, :1].expand_as(LOCAL)
    assert any("have the same 3D joints to the last digit" in line for line in said(world))
