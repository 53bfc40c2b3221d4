"""Pairs of many frames and views in one padded tensor."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from perfcap.errors import InputError
from perfcap.segment.correspondence import Correspondences, Matches, stack


def matches(count: int, seed: int = 0) -> Matches:
    rng = np.random.default_rng(seed)
    share, turn = rng.random(count), rng.random(count)
    return Matches(
        rng.integers(0, 50, (count, 2)),
        np.stack([share, 1 - share], 1),
        100 * rng.random((count, 2)),
        np.stack([np.cos(turn), np.sin(turn)], 1),
        0.1 + 0.9 * rng.random(count),
        np.arange(count),
        np.arange(count),
    )


def test_stack_pads_to_the_longest() -> None:
    rows = [[matches(3, 0), matches(0)], [matches(1, 1), matches(5, 2)]]
    pairs = stack(rows, torch.zeros(1, dtype=torch.float64))
    assert pairs.confidence.shape == (2, 2, 5)
    assert pairs.vertices.shape == (2, 2, 5, 2)
    assert (pairs.frame_count, pairs.views) == (2, 2)
    assert (pairs.confidence > 0).sum() == 9
    for frame, row in enumerate(rows):
        for view, each in enumerate(row):
            count = len(each)
            np.testing.assert_array_equal(pairs.vertices[frame, view, :count], each.vertices)
            np.testing.assert_array_equal(pairs.target[frame, view, :count], each.target)
            np.testing.assert_array_equal(pairs.confidence[frame, view, :count], each.confidence)
            assert (pairs.confidence[frame, view, count:] == 0).all()
            assert (pairs.vertices[frame, view, count:] == 0).all()
    torch.testing.assert_close(pairs.weights.sum(-1), torch.ones_like(pairs.confidence))


def test_nothing_anywhere_still_has_a_shape() -> None:
    like = torch.zeros(1)
    pairs = stack([[matches(0)], [matches(0)]], like)
    assert pairs.confidence.shape == (2, 1, 1)
    assert (pairs.confidence == 0).all()
    assert stack([], like).confidence.shape == (0, 0, 1)


def test_frames_and_type() -> None:
    pairs = stack([[matches(2, seed)] for seed in range(4)], torch.zeros(1))
    assert pairs.target.dtype == torch.float32
    part = pairs.frames(slice(1, 3))
    torch.testing.assert_close(part.normal, pairs.normal[1:3])
    torch.testing.assert_close(part.vertices, pairs.vertices[1:3])
    double = part.to(torch.zeros(1, dtype=torch.float64))
    assert double.confidence.dtype == double.weights.dtype == torch.float64
    assert double.vertices.dtype == torch.int64
    batched = Correspondences(
        *(getattr(pairs, name)[None] for name in ("vertices", "weights", "target", "normal")),
        pairs.confidence[None],
    )
    picked = batched.frames(torch.tensor([3, 0]))
    torch.testing.assert_close(picked.target[0], pairs.target[[3, 0]])
    apart = pairs.apart()
    assert apart.confidence.shape == (4, 1, *pairs.confidence.shape[1:])
    torch.testing.assert_close(apart.target[:, 0], pairs.target)


def test_bad_input() -> None:
    with pytest.raises(InputError, match="same views"):
        stack([[matches(1)], [matches(1), matches(1)]], torch.zeros(1))
    pairs = stack([[matches(2)]], torch.zeros(1))
    with pytest.raises(InputError, match="target has shape"):
        Correspondences(
            pairs.vertices, pairs.weights, pairs.target[..., :1], pairs.normal, pairs.confidence
        )
    with pytest.raises(InputError, match=r"torch\.int32"):
        Correspondences(
            pairs.vertices.int(), pairs.weights, pairs.target, pairs.normal, pairs.confidence
        )
    with pytest.raises(InputError, match="expected"):
        Correspondences(
            pairs.vertices[0],
            pairs.weights[0],
            pairs.target[0],
            pairs.normal[0],
            pairs.confidence[0],
        )
