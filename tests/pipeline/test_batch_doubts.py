"""Frames that are given as clips, and clips as frames."""

from __future__ import annotations

import warnings

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS16
from perfcap.pipeline import PoseRefiner
from perfcap.pipeline.batch_doubts import once_of_most

TAKE = make_take(24)
PIXELS = TAKE.detections.joints2d


def said(clips: Tensor) -> list[str]:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        PoseRefiner(TAKE.actor).eval()(TAKE.cameras, clips)
    return [str(each.message) for each in found if "follow one another" in str(each.message)]


@pytest.mark.long
def test_frames_of_a_motion_as_clips() -> None:
    """Each was solved on its own: three times the error on one recording."""
    (line,) = said(PIXELS[:, None])
    assert "24 clips of 1 frame follow one another" in line and "(F, C, J, 2)" in line


@pytest.mark.long
def test_exchanged_axes() -> None:
    clips = PIXELS.reshape(3, 8, *PIXELS.shape[1:])
    (line,) = said(clips.transpose(0, 1))
    assert "8 clips of 3 frames follow one another" in line and "clips first" in line


@pytest.mark.long
@pytest.mark.parametrize("length", [1, 3, 8])
def test_right_batches_are_not_named(length: int) -> None:
    shuffled = torch.randperm(24, generator=torch.Generator().manual_seed(0))
    clips = PIXELS[shuffled, None] if length == 1 else PIXELS.unfold(0, length, 2).movedim(-1, 1)
    assert said(clips) == []


@pytest.mark.long
@pytest.mark.parametrize("length", [1, 4])
def test_short_clips_show_together_what_each_does_not(length: int) -> None:
    """Sides, depth and axes are judged by ten frames or more."""
    poses = TAKE.detections.joints3d
    assert poses is not None
    shuffled = torch.randperm(24, generator=torch.Generator().manual_seed(0))
    parts = [each[shuffled] for each in (PIXELS, TAKE.detections.confidence2d, poses)]
    pixels, sure, poses = (each.unflatten(0, (-1, length)) for each in parts)
    exchanged = poses[..., [1, 0, 2]]

    def told(poses: Tensor, lead: int) -> list[str]:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            given = (each[:lead] for each in (pixels, sure, poses))
            PoseRefiner(TAKE.actor).eval()(TAKE.cameras, *given)
        return [str(each.message) for each in found]

    line, alone = told(exchanged, 24)  # and not of each that its feet point backwards
    assert "most clips alone: view 0: left and right look exchanged" in alone
    assert f"the {24 // length} clips together: view 0: x and y look exchanged" in line
    assert not told(poses, 24)
    assert "x and y look exchanged" not in "".join(told(exchanged, 1))  # which shows less


def test_what_only_single_clips_show_is_said_of_them() -> None:
    told = [["feet", "pose 3"], ["feet"], [], ["feet", "depth"]]
    assert once_of_most(told) == (["feet"], [["pose 3"], [], [], ["depth"]])
    half = [["feet"], ["depth"]]
    assert once_of_most(half) == ([], half)  # nothing is lost of two clips that differ


def shuffled_images(exchanged: float, *, bones: float = 0.0) -> list[str]:
    """What is said of single images of three views, in a share of which sides are exchanged."""
    take = make_take(24, views=3, lifted=False, turns=0.3)
    chance = torch.Generator().manual_seed(0)
    order = torch.randperm(24, generator=chance)
    pixels = take.detections.joints2d[order]
    wrong = torch.rand(24, generator=chance) < exchanged
    mirrored = pixels[:, :, list(LANDMARKS16.mirrored())]
    pixels = torch.where(wrong[:, None, None, None], mirrored, pixels)
    actor = take.actor
    if bones:
        groups = len(actor.skeleton.group_names)
        actor = actor.resized(torch.full((groups,), bones, dtype=torch.float64))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        PoseRefiner(actor).eval()(take.cameras, pixels[:, None])
    return [str(each.message) for each in found]


@pytest.mark.long
def test_single_images_of_several_views_are_examined_together() -> None:
    """Each was said to have hardly any joint that two views see, and nothing else was looked at."""
    assert shuffled_images(0.0) == []
    (line,) = shuffled_images(1.0)
    assert "24 clips together: detections: left and right look exchanged: the feet" in line


@pytest.mark.long
def test_sides_that_are_exchanged_in_half_of_the_images() -> None:
    (line,) = shuffled_images(0.5)
    assert "left and right look exchanged in" in line and "of 24 images" in line


@pytest.mark.long
def test_bones_show_in_several_images() -> None:
    (line,) = shuffled_images(0.0, bones=0.3)
    assert "24 clips together: the actor's legs are 1.3" in line


@pytest.mark.long
@pytest.mark.parametrize("share", [0.0, 0.35])
def test_poses_of_which_some_are_mirror_images(share: float) -> None:
    """As where an augmentation mirrors images and 2D joints, and forgets the poses."""
    take = make_take(24, turns=0.3)
    poses, chance = take.detections.joints3d, torch.Generator().manual_seed(0)
    assert poses is not None
    order, wrong = torch.randperm(24, generator=chance), torch.rand(24, generator=chance) < share
    mirrored = (poses * poses.new_tensor([-1, 1, 1]))[:, :, list(LANDMARKS16.mirrored())]
    poses = torch.where(wrong[:, None, None, None], mirrored, poses)[order]
    pixels = take.detections.joints2d[order]
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        PoseRefiner(take.actor).eval()(take.cameras, pixels[:, None], joints3d=poses[:, None])
    told = [str(each.message) for each in found if "together" in str(each.message)]
    assert len(told) == (share > 0)
    assert all("mirror images of the 2D joints, left and right exchanged, in" in x for x in told)
