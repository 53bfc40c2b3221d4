"""Joints that go over from one person to another."""

import pytest
import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io.doctor.jumps import examine_jumps

FRAMES, SIZE = 60, 200.0
SURE = torch.ones(FRAMES, 16)


def body(x: float, speed: float = 3.0, noise: float = 1.5, seed: int = 0) -> Tensor:
    """Somebody who walks across the image and bows, (F, 16, 2) px, a frame each 1/30 s."""
    generator = torch.Generator().manual_seed(seed)
    rest = torch.rand(16, 2, generator=generator) * torch.tensor([60.0, SIZE])
    rest[0, 1], rest[15, 1] = 0.0, SIZE
    time = torch.arange(FRAMES)[:, None]
    place = torch.cat((x + speed * time, 30 * torch.sin(time / 8)), 1)
    return rest + place[:, None] + noise * torch.randn(FRAMES, 16, 2, generator=generator)


def told(pixels: Tensor, confidence: Tensor = SURE) -> str:
    found = examine_jumps("front", pixels, confidence[: len(pixels)])
    return " ".join(each.what for each in found)


@pytest.mark.parametrize("speed", [0.0, 3.0, 25.0])
@pytest.mark.parametrize("noise", [0.0, 1.5, 6.0])
def test_one_person_does_not_jump(speed: float, noise: float) -> None:
    assert not told(body(100, speed, noise))
    assert not told(body(100, speed, noise)[:7]) and not told(body(100, speed, noise)[:0])


@pytest.mark.parametrize("apart", [70.0, -120.0, 400.0])
@pytest.mark.parametrize("frame", [5, 30, 50])
def test_somebody_else_from_a_frame_on(apart: float, frame: int) -> None:
    mixed = torch.cat((body(100)[:frame], body(100 + apart, seed=1)[frame:]))
    assert f"(frames {frame} of the capture, counted from 0)" in told(mixed)
    moved = mixed * 3.7 + 40  # of larger images
    assert f"(frames {frame} of the capture, counted from 0)" in told(moved)


def test_sides_and_single_joints_that_jump_are_nobody_else() -> None:
    swapped = body(100)
    swapped[20:] = swapped[20:, list(LANDMARKS16.mirrored())]
    assert not told(swapped)
    wild = body(100)
    wild[30, LANDMARKS.index("l_hip")] += 300
    assert not told(wild)


def test_whoever_is_found_elsewhere() -> None:
    unseen = SURE.clone()
    unseen[20:32] = 0
    assert not told(body(100), unseen)  # bridged
    other = torch.cat((body(100)[:30], body(700, seed=1)[30:]))
    assert "(frames 32 of the capture, counted from 0)" in told(other, unseen)


def test_nobody_at_all() -> None:
    assert not told(body(100), 0 * SURE)
    assert not told(torch.full((FRAMES, 16, 2), torch.nan), 0 * SURE)
