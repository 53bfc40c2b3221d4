"""Places in another unit or other axes than bones, by the foot that stands."""

import pytest
import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.pipeline.place_units import place_doubts

RATE, LEGS = 30.0, 0.9


def said(landmarks: Tensor) -> list[str]:
    """All that is odd about a motion."""
    return list(place_doubts(landmarks, RATE, LEGS))


def walk(factor: float = 1.0, speed: float = 1.2, frames: int = 90) -> Tensor:
    """Hips that go over one foot after the other, at places that are wrong by a factor."""
    time = torch.arange(frames).double() / RATE
    hips = torch.stack((speed * time, 0.9 + 0.02 * (12 * time).sin(), 0 * time), -1)
    points = hips[:, None].repeat(1, 16, 1)
    for side, late in (("l", 0.0), ("r", 0.5)):
        phase = (time + late) % 1.0
        stands = phase < 0.5
        start = speed * (time - phase)
        along = torch.where(stands, start + 0.25 * speed, start + speed * (2 * phase - 0.75))
        up = torch.where(stands, 0.08, 0.08 + 0.2 * (2 * torch.pi * (phase - 0.5)).sin())
        for name, ahead in (("ankle", 0.0), ("toe", 0.15)):
            place = torch.stack((along + ahead, up, 0 * time), -1)
            points[:, LANDMARKS.index(f"{side}_{name}")] = place
    return points + (factor - 1) * hips[:, None]


@pytest.mark.parametrize("factor", [0.01, 0.0254, 0.39, 2.54, 100.0])
def test_other_units_are_found(factor: float) -> None:
    (line,) = place_doubts(walk(factor), RATE, LEGS)
    assert "another unit than its bones" in line
    found = float(line.split("places were ")[1].split(" times")[0])
    assert found == pytest.approx(1 / factor, rel=0.1)


@pytest.mark.parametrize(
    ("axes", "told"),
    [
        ([-1.0, 1.0, 1.0], "(-x, y, z)"),
        ([[0.0, 0, 1], [0, 1, 0], [1, 0, 0]], "(z, y, x)"),
        ([1.0, 1.0, -1.0], ""),  # along which nobody walks
    ],
)
def test_other_axes_are_found(axes: list[float], told: str) -> None:
    """A person walked backwards or aside while their legs went ahead, with nothing said."""
    right = walk()
    turn = torch.tensor(axes).double()
    turn = torch.diag(turn) if turn.ndim == 1 else turn
    hips = mid_hip(right)[:, None]
    lines = list(place_doubts(right + hips @ turn.mT - hips, RATE, LEGS))
    assert len(lines) == bool(told) and all(told in line for line in lines), lines


def test_right_units_and_motions_that_do_not_say() -> None:
    assert not said(walk())
    assert not said(walk(0.7))  # a stylised figure
    spot = walk()
    spot = spot - torch.stack((spot[:, 1, 0], 0 * spot[:, 1, 0], 0 * spot[:, 1, 0]), -1)[:, None]
    assert not said(spot)
    assert not said(walk(0.01)[:10])
    still = walk(0.01)[:1].repeat(60, 1, 1)
    assert not said(still)
    floats = walk()
    floats[:, [LANDMARKS.index(name) for name in ("l_ankle", "r_ankle", "l_toe", "r_toe")]] = (
        torch.rand(90, 4, 3, generator=torch.Generator().manual_seed(0)).double()
    )
    assert not said(floats)
