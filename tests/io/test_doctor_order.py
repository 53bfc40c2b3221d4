"""Frames whose names were sorted as text."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

import perfcap
from perfcap.detect.frame_order import Steps, Way, sorted_as_text
from perfcap.io import models_folder
from perfcap.io.doctor.order import examine_order, examine_shuffled
from perfcap.pipeline.input_doubts import input_doubts

DEMO = models_folder() / "demo"
DUO = Path(__file__).parents[3] / "shared" / "data" / "rendered_multi" / "dev_duo"
needs_data = pytest.mark.skipif(not DUO.is_dir(), reason="needs the rendered views")
SEEN = perfcap.read_detections([DEMO / "detections.npz"])[0]


def in_text_order(count: int, first: int) -> torch.Tensor:
    return torch.tensor(sorted(range(first, first + count), key=str)) - first


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("count", [20, 47, 120])
def test_text_order_is_named_and_no_other(count: int, first: int) -> None:
    part = SEEN.frames(slice(count))
    pixels, sure = part.joints2d[:, 0], part.confidence2d[:, 0]
    assert not examine_order("view", pixels, sure)
    assert not examine_order("view", pixels.flip(0), sure.flip(0))
    order = in_text_order(count, first)
    (found,) = examine_order("view", pixels[order], sure[order])
    assert "sorted as text (1, 10, 2)" in found.what


@needs_data
@pytest.mark.parametrize(("person", "first", "count"), [(1, 0, 20), (1, 0, 24), (2, 0, 24)])
def test_whoever_is_seen_in_half_of_the_frames_is_in_order(
    person: int, first: int, count: int
) -> None:
    """Sorted otherwise few of these frames follow one another, and those may be near by chance."""
    names = perfcap.read_cameras(DUO / "cameras.json").names
    path = DUO / f"person{person}" / "detections.npz"
    part = perfcap.read_detections([path], views=names)[0].frames(slice(first, first + count))
    sure = part.confidence2d[:, 0].clone()
    assert not examine_order("view", part.joints2d[:, 0], sure)
    sure[count // 2 :] = 0
    assert not examine_order("view", part.joints2d[:, 0], sure)


def test_an_order_that_knows_fewer_steps_is_none() -> None:
    def steps(known: int) -> Way:
        return lambda order: (
            Steps(1.0, 11) if bool((order.diff() == 1).all()) else Steps(0.5, known)
        )

    assert sorted_as_text(steps(11), 24) == 0.5
    assert sorted_as_text(steps(6), 24) is None


def test_text_order_of_whoever_is_away_for_a_while() -> None:
    part = SEEN.frames(slice(60))
    order, sure = in_text_order(60, 1), part.confidence2d[:, 0].clone()
    sure[20:35] = 0
    (found,) = examine_order("view", part.joints2d[order, 0], sure[order])
    assert "sorted as text (1, 10, 2)" in found.what


def test_noise_and_few_frames_say_nothing() -> None:
    random = torch.Generator().manual_seed(0)
    still = 300 + 5 * torch.randn(60, 16, 2, generator=random)
    assert not examine_order("view", still, torch.ones(60, 16))
    assert not examine_order("view", still, torch.zeros(60, 16))
    assert not examine_order("view", still[:5], torch.ones(5, 16))


def test_a_capture_says_so() -> None:
    rig = perfcap.read_cameras(DEMO / "camera.json")
    told = input_doubts(rig.cameras, SEEN.frames(in_text_order(60, 1)))
    assert any("sorted as text" in line for line in told)
    assert not any("jump" in line for line in told)


@pytest.mark.long
@pytest.mark.parametrize("count", [12, 30, 90])
def test_images_that_do_not_follow_one_another_are_named(count: int) -> None:
    """As in a shuffled batch; by 3D poses where nothing is seen in an image."""
    rig = perfcap.read_cameras(DEMO / "camera.json")
    part = SEEN.frames(slice(0, 120, 120 // count))
    assert not any("follow" in line for line in input_doubts(rig.cameras, part))
    order = torch.randperm(part.frame_count, generator=torch.Generator().manual_seed(1))
    for seen in (part, replace(part, confidence2d=0 * part.confidence2d)):
        told = input_doubts(rig.cameras, seen.frames(order))
        assert any("images that do not follow one another" in line for line in told)


def test_who_hardly_moves_is_not_shuffled() -> None:
    random = torch.Generator().manual_seed(0)
    place = 300 * torch.rand(16, 2, generator=random)
    still = place + 5 * torch.randn(60, 16, 2, generator=random)
    assert not examine_shuffled("view", still, torch.ones(60, 16))
    assert not examine_shuffled("view", still, torch.zeros(60, 16))
    moving = 300 * torch.rand(60, 16, 2, generator=random)
    assert examine_shuffled("view", moving, torch.ones(60, 16))
    assert not examine_shuffled("view", moving[:7], torch.ones(7, 16))
