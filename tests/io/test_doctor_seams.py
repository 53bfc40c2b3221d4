"""Parts of a clip that do not follow one another."""

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import examine_detections
from perfcap.io.doctor.seams import examine_seams

FRAMES, VIEWS, SIZE = 60, 3, 200.0
NAMES = ["left", "front", "right"]
SURE = torch.ones(FRAMES, VIEWS, 16)


def dance(noise: float = 1.5, tempo: float = 8.0, seed: int = 0) -> Tensor:
    """Limbs that swing about a trunk that stays, (F, C, 16, 2) px; a frame each 1/30 s."""
    generator = torch.Generator().manual_seed(seed)
    rest = torch.rand(VIEWS, 16, 2, generator=generator) * torch.tensor([60.0, SIZE])
    rest[:, 0, 1], rest[:, 15, 1] = 0.0, SIZE
    swing = 40 * torch.randn(VIEWS, 16, 2, generator=generator)
    phase = 2 * torch.pi * torch.rand(16, 1, generator=generator)
    time = torch.arange(FRAMES)[:, None, None, None]
    return (
        rest
        + swing * torch.sin(time / tempo + phase)
        + noise * torch.randn(FRAMES, VIEWS, 16, 2, generator=generator)
    )


def said(pixels: Tensor, confidence: Tensor = SURE, views: int = VIEWS) -> str:
    shown = pixels[:, :views], confidence[: len(pixels), :views]
    return " ".join(str(each) for each in examine_seams(NAMES[:views], *shown))


@pytest.mark.parametrize("views", [1, 2, 3])
@pytest.mark.parametrize("noise", [0.0, 1.5, 6.0])
def test_what_goes_on_has_no_seam(noise: float, views: int) -> None:
    for seed in range(5):
        pixels = dance(noise, seed=seed)
        assert not said(pixels, views=views)
        assert not said(pixels[:7], views=views) and not said(pixels[:0], views=views)


def test_nor_has_what_goes_fast_in_few_frames_a_second() -> None:
    assert not said(dance(tempo=2.5))


@pytest.mark.parametrize("views", [1, 2, 3])
@pytest.mark.parametrize("frame", [5, 30, 50])
def test_parts_that_were_put_together(frame: int, views: int) -> None:
    parts = torch.cat((dance()[:frame], dance().roll(20, 0)[frame:]))
    assert f"from frames {frame} on" in said(parts, views=views)
    assert f"from frames {frame} on" in said(parts * 3.7 + 40, views=views)  # of larger images
    assert said(parts, views=views).startswith(
        "warning: left: joints" if views == 1 else "warning: detections: joints are elsewhere in"
    )


def test_joints_that_go_over_in_one_of_several_views_are_of_that_view() -> None:
    mixed = dance()
    mixed[30:, 1] = dance(seed=1)[30:, 1] + 80
    assert not said(mixed)
    assert "from frames 30 on" in " ".join(
        str(each) for each in examine_seams(NAMES[1:2], mixed[:, 1:2], SURE[:, 1:2])
    )


def test_sides_and_single_joints_have_no_seam() -> None:
    swapped = dance()
    swapped[20:] = swapped[20:, :, list(LANDMARKS16.mirrored())]
    assert not said(swapped) and not said(swapped, views=1)
    wild = dance()
    wild[30, :, LANDMARKS.index("l_hip")] += 300
    assert not said(wild)


def test_what_is_not_seen_has_none() -> None:
    parts = torch.cat((dance()[:30], dance().roll(20, 0)[30:]))
    unseen = SURE.clone()
    unseen[28:33] = 0
    assert not said(parts, unseen)
    assert not said(parts, 0 * SURE)
    assert not said(torch.full_like(parts, torch.nan), 0 * SURE)
    alone = SURE.clone()
    alone[:, 1:] = 0  # of several views one alone may go over to another person
    assert not said(parts, alone)


JOINED = torch.cat((torch.arange(20), torch.arange(40, 60)))


@pytest.mark.parametrize("views", [1, 3])
def test_detections_are_examined(views: int) -> None:
    take = make_take(60, views=views, turns=0.2)
    cameras = CameraRig(tuple(NAMES[:views]), take.cameras)
    assert not examine_detections(cameras, take.detections)
    finding = examine_detections(cameras, take.detections.frames(JOINED))[0]
    assert finding.subject == ("left" if views == 1 else "detections")
    assert "from frames 20 on" in finding.what
    assert not finding.views  # no joint is to blame
    picked = examine_detections(cameras, take.detections.frames(JOINED), successive=False)
    assert not any("elsewhere" in each.what for each in picked)


def test_cameras_that_move_are_left_alone() -> None:
    take = make_take(60, views=3, turns=0.2, moving=True)
    cameras = CameraRig(tuple(NAMES), take.cameras.frames(JOINED))
    found = examine_detections(cameras, take.detections.frames(JOINED))
    assert not any("elsewhere" in each.what for each in found)
