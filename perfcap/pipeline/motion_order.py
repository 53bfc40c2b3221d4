"""Whether frames of a motion follow one another: else joints in space leap, or stay."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from perfcap.io.doctor.backwards import examine_backwards
from perfcap.io.doctor.finding import Finding, ranges
from perfcap.io.doctor.order import examine_order, examine_shuffled
from perfcap.io.doctor.repeated import examine_held


def order_doubts(position: Tensor) -> Iterator[str]:
    """Sentences about frames in no order, sorted as text, played backwards, or held.

    Args:
        position: of joints in the world, (F, 16, 3) metres.
    """
    joints = position.detach().double().cpu()
    sure = torch.ones_like(joints[..., 0])
    order = examine_order("", joints, sure) or examine_shuffled("", joints, sure)
    yield from map(_sentence, order)
    for found in () if order else examine_backwards("", 0, joints, sure):
        yield (
            f"frames {ranges(found.frames)} (counted from 0) look as if played backwards: joints "
            f"leap where they begin and end, and would not the other way round; {found.remedy}"
        )
    for found in examine_held("", joints, sure):
        yield (
            f"{found.what}; no recorded motion does: leave such frames out unless the person is "
            "to stand still there, and give the rate at which it was recorded"
        )


def _sentence(found: Finding) -> str:
    return f"{found.what}; {found.remedy}"
