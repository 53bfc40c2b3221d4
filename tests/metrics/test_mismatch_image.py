"""Truths in images that contradict the other truth are named, right and noisy ones are not."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import pytest
import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS16
from perfcap.metrics import pixel_mismatches, silhouette_mismatches

FRAMES, VIEWS = 40, ("left", "right")
ORDER = LANDMARKS16.mirrored()


def walk() -> Tensor:
    """Joints of somebody who walks and swings through two images, (F, 2, 16, 2) px."""
    generator = torch.Generator().manual_seed(0)
    pose = torch.rand(2, 16, 2, generator=generator).double() * torch.tensor([120.0, 300.0])
    time = torch.arange(FRAMES).double()[:, None, None, None]
    phase = 6 * torch.rand(2, 16, 2, generator=generator).double()
    swing = 12 * torch.sin(time / 4 + phase)
    return pose + torch.tensor([150.0, 80.0]) + swing + time * torch.tensor([3.0, 0.0])


def late(points: Tensor) -> Tensor:
    return torch.cat((points[:1].expand(3, -1, -1, -1), points[:-3]))


def noisy(points: Tensor) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    return points + 6 * torch.randn(points.shape, generator=generator, dtype=points.dtype)


def shuffled(points: Tensor) -> Tensor:
    return points[:, :, torch.randperm(16, generator=torch.Generator().manual_seed(2))]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (late, "views left, right: .* with those of 3 frames later 0 px are left"),
        (lambda p: p / 2, "if their image is 0.5 times as large 0 px are left"),
        (lambda p: p[:, :, ORDER], "with left and right exchanged 0 px"),
        (lambda p: p + torch.tensor([20.0, -9.0]), "if moved by 20, -9 px 0 px are left"),
        (lambda p: p.flip(1), "view left: .* as those of view right 0 px"),
        (shuffled, "views left, right: .* see its joints; check that cameras, joints and images"),
    ],
)
def test_joints_that_the_cameras_do_not_see_there(
    change: Callable[[Tensor], Tensor], said: str
) -> None:
    lines = pixel_mismatches(walk(), change(walk()), ORDER, VIEWS)
    assert lines
    assert any(re.search(said, line) for line in lines), lines


def test_one_view_alone_is_named() -> None:
    points = walk()
    points[:, 1] *= 2
    (line,) = pixel_mismatches(walk(), points, ORDER, VIEWS)
    assert line.startswith("view right: ")


def test_many_wrong_views_are_one_line() -> None:
    points = walk()[:, :1].expand(-1, 6, -1, -1)
    aside = torch.tensor([[20.0 + 9 * view, 7.0] for view in range(6)])[:, None]
    (line,) = pixel_mismatches(points, points + aside, ORDER, "abcdef")
    assert line.startswith("views a, b, c, d, e, f: annotated joints lie 21 to 65 px from")


@pytest.mark.parametrize("change", [lambda p: p, noisy, lambda p: torch.full_like(p, torch.nan)])
def test_right_noisy_and_unknown_joints_are_not_named(change: Callable[[Tensor], Tensor]) -> None:
    assert pixel_mismatches(walk(), change(walk()), ORDER, VIEWS) == ()


@pytest.mark.parametrize("part", [slice(0, 12), slice(14, 29), slice(28, 40)])
@pytest.mark.parametrize("frames", [(), range(200, 240)])
def test_sides_that_are_exchanged_in_a_part(part: slice, frames: Sequence[int]) -> None:
    points = noisy(walk())
    points[part] = points[part][:, :, ORDER]
    (line,) = pixel_mismatches(walk(), points, ORDER, VIEWS, frames)
    count = part.stop - part.start
    where = (
        f"frames {200 + part.start} to {199 + part.stop}" if frames else f"{count} frames in a row"
    )
    assert line.startswith("views left, right: ")
    assert f"joints in {where}; with left and right exchanged" in line


def test_a_part_that_is_late() -> None:
    points = walk()
    points[20:] = late(points)[20:]
    (line,) = pixel_mismatches(walk(), points, ORDER, VIEWS, range(40))
    assert "in frames 20 to " in line and "with those of 3 frames later 0 px are left" in line


# --- Silhouettes ----------------------------------------------------------------------------------

LAGS = tuple(range(-4, 5))


def figures(count: int = 12) -> Tensor:
    """Somebody with a raised arm who walks to the right, (F, 120, 120) bool."""
    masks = torch.zeros(count, 120, 120, dtype=torch.bool)
    for frame, mask in enumerate(masks):
        left = 20 + 4 * frame
        mask[30:100, left : left + 14] = True
        mask[18:30, left + 3 : left + 11] = True
        mask[40:46, left + 14 : left + 26 + frame] = True
        mask[96:100, left : left + 20] = True
    return masks


def around(masks: Tensor) -> Tensor:
    """The masks of the frames around each, none beyond the ends."""
    rows = torch.arange(len(masks))[:, None] + torch.tensor(LAGS)
    there = (rows >= 0) & (rows < len(masks))
    return masks[rows.clamp(0, len(masks) - 1)] & there[..., None, None]


def moved(masks: Tensor) -> Tensor:
    return masks.roll((4, -6), (-2, -1))


def squeezed(masks: Tensor) -> Tensor:
    rows = ((torch.arange(120) - 20) / 0.75).round().long()
    inside = (rows >= 0) & (rows < 120)
    return masks[:, rows.clamp(0, 119)] & inside[:, None]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: torch.cat((m[:1], m[:-1])), "if true ones of 1 frame later are taken"),
        (lambda m: torch.cat((m[2:], m[-1:].expand(2, -1, -1))), "of 2 frames earlier"),
        (lambda m: m.flip(-1), "if they are mirrored"),
        (lambda m: m.flip(-2), "upside down in a mirror"),
        (lambda m: m.flip(-1, -2), "if they are turned upside down"),
        (lambda m: ~m, "if they are inverted"),
        (lambda m: m.mT, "if rows and columns are exchanged"),
        (moved, "if the true ones lie -12, 8 px aside"),
        (squeezed, "0.74 times as tall"),
    ],
)
def test_wrong_silhouettes_are_explained(change: Callable[[Tensor], Tensor], said: str) -> None:
    (line,) = silhouette_mismatches(figures(), around(change(figures())), LAGS, scale=2.0)
    assert said in line and line.startswith("overlap at ")


def test_silhouettes_of_another_clip() -> None:
    other = torch.zeros(12, 120, 120, dtype=torch.bool)
    other[:, 60:110, 5:60] = True
    (line,) = silhouette_mismatches(figures(), around(other), LAGS)
    assert line.startswith("overlap at ")


def rough(masks: Tensor) -> Tensor:
    """One pixel thicker all around."""
    return torch.nn.functional.max_pool2d(masks.float(), 3, 1, 1) > 0.5


@pytest.mark.parametrize("change", [lambda m: m, rough, torch.zeros_like])
def test_right_rough_and_empty_silhouettes_are_not(change: Callable[[Tensor], Tensor]) -> None:
    assert silhouette_mismatches(figures(), around(change(figures())), LAGS) == ()
