"""Overlap and outlines of silhouettes."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.metrics import boundary_f, mask_overlap, silhouette_scores
from perfcap.metrics.masks import outline


def disk(radius: float, size: int = 60, across: float = 30.0) -> Tensor:
    y, x = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    return ((x - across) ** 2 + (y - 30.0) ** 2) <= radius**2


def test_scores_of_a_batch_are_those_of_each() -> None:
    masks = torch.stack([disk(10), disk(15), torch.zeros(60, 60, dtype=torch.bool)])
    truth = torch.stack([disk(12), disk(15), disk(5)])
    scores = silhouette_scores(masks, truth)
    for index in range(3):
        one = mask_overlap(masks[index].numpy(), truth[index].numpy())
        assert (one.iou, one.precision, one.recall) == (
            scores.iou[index],
            scores.precision[index],
            scores.recall[index],
        )
        assert boundary_f(masks[index], truth[index]) == scores.boundary_f[index]
    assert scores.iou[1] == scores.boundary_f[1] == 1
    assert scores.iou[2] == scores.boundary_f[2] == 0
    assert scores.precision[0] == 1 and scores.recall[0] < 1


def test_nothing_on_both_sides_agrees() -> None:
    nothing = torch.zeros(8, 8, dtype=torch.bool)
    scores = silhouette_scores(nothing, nothing)
    assert scores.iou == scores.boundary_f == scores.recall == 1


@pytest.mark.parametrize(("shift", "radius", "score"), [(3, 3, 1.0), (3, 1, 0.0)])
def test_outlines_within_the_radius_are_correct(shift: int, radius: int, score: float) -> None:
    place = torch.arange(40).expand(40, 40)
    assert boundary_f(place < 20, place < 20 + shift, radius) == score


def test_the_disk_is_round() -> None:
    """A point at (3, 4) is within 5 pixels, one at (4, 4) is not."""
    truth = torch.zeros(2, 31, 31, dtype=torch.bool)
    mask = truth.clone()
    truth[:, 15, 15] = True
    mask[0, 18, 19], mask[1, 19, 19] = True, True
    assert boundary_f(mask, truth, 5).tolist() == [1, 0]


def test_the_border_of_the_image_is_no_outline() -> None:
    full = torch.ones(1, 1, 5, 6, dtype=torch.bool)
    assert not outline(full).any()
    full[..., 2, 2] = False
    assert outline(full).sum() == 4


def test_radius_follows_the_image() -> None:
    """0.8 % of 250 pixels of diagonal is 2."""
    place = torch.arange(200).expand(150, 200)
    assert boundary_f(place < 90, place < 92) == 1
    assert boundary_f(place < 90, place < 93) == 0


def test_refuses() -> None:
    with pytest.raises(InputError, match="one size"):
        silhouette_scores(disk(3), disk(3)[:5])
    with pytest.raises(InputError, match="expected bool"):
        silhouette_scores(disk(3).float(), disk(3))
    with pytest.raises(InputError, match="one size"):
        mask_overlap(np.zeros((2, 2), bool), np.zeros((2, 3), bool))
