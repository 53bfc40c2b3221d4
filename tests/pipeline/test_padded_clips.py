"""Lengths of a padded batch that belong to its clips, or to others of them."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.pipeline.padded_clips import cut_clips

LENGTHS = [14, 30, 22]


def padded(kind: str) -> Tensor:
    """Clips (3, 30, 2, 16, 2), filled up in one of the usual ways."""
    joints = 100 + torch.rand(3, 30, 2, 16, 2, generator=torch.Generator().manual_seed(0))
    for clip, count in zip(joints, LENGTHS, strict=True):
        clip[count:] = {"zeros": 0.0, "nan": torch.nan, "last": clip[count - 1]}[kind]
    return joints


@pytest.mark.parametrize("kind", ["zeros", "nan", "last"])
def test_lengths_in_another_order_are_refused(kind: str) -> None:
    """As where they were sorted, and the clips were not: frames were lost with no word."""
    joints = padded(kind)
    clips, _ = cut_clips("joints2d", joints, 4, LENGTHS) or ([], True)
    assert [len(clip) for clip in clips] == LENGTHS
    for other in ([30, 22, 14], [14, 22, 30]):
        with pytest.raises(InputError, match=r"end after \[14, 30, 22\] frames"):
            cut_clips("joints2d", joints, 4, torch.tensor(other))


def test_other_lengths_are_taken() -> None:
    """Parts of clips, a person who leaves, confidences that are all alike."""
    joints = padded("zeros")
    for lengths in ([14, 22, 22], [10, 20, 20], [30, 30, 30]):
        assert cut_clips("joints2d", joints, 4, lengths) is not None
    joints[1, 28:] = 0
    assert cut_clips("joints2d", joints, 4, LENGTHS) is not None
    assert cut_clips("confidence2d", torch.ones(3, 30, 2, 16), 3, [30, 22, 14]) is not None
    assert cut_clips("joints2d", torch.rand(3, 30, 2, 16, 2), 4, [30, 22, 14]) is not None
