"""Refinements that are taken back where they do harm."""

import numpy as np
import torch

from perfcap.pipeline.overlap import keep_better


def test_what_helps_everywhere_is_kept_whole() -> None:
    before = np.full(9, 0.5)
    share, after, kept = keep_better(lambda share: share, lambda s: 0.5 + 0.1 * s.numpy(), before)
    assert kept.all()
    assert share.tolist() == [1.0] * 9
    np.testing.assert_allclose(after, 0.6)


def test_what_harms_is_given_back_and_neighbours_fade() -> None:
    gain = np.full(9, 0.1)
    gain[4] = -0.2
    before = np.full(9, 0.5)
    share, after, kept = keep_better(lambda s: s, lambda s: 0.5 + gain * s.numpy(), before)
    assert np.flatnonzero(~kept).tolist() == [4]
    np.testing.assert_allclose(share, [1, 1, 2 / 3, 1 / 3, 0, 1 / 3, 2 / 3, 1, 1])
    assert (after >= before).all()


def test_neighbours_that_fading_harms_are_given_back_too() -> None:
    """Whole they help, but not in part: each one given back takes the next along."""
    before = np.full(12, 0.5)

    def overlaps(share: torch.Tensor) -> np.ndarray:
        part = share.numpy()
        overlap = np.where((part > 0) & (part < 1), 0.3, 0.5 + 0.1 * part)
        overlap[0] -= 0.3 * part[0]
        return overlap

    share, after, kept = keep_better(lambda s: s, overlaps, before)
    assert not kept.any()
    assert not share.any()
    assert (after >= before).all()
