"""The next pose, from those before it (Liu et al. 2013, Sec. 4.1.1)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.solve import Step


def predict(history: Sequence[Motion], memory: float) -> Motion:
    """The pose (1,) that follows poses (1,), by a linear autoregression of third order.

    Each step is a combination of the two before it, and so each pose of the three before it (Liu et
    al. 2013, Sec. 4.1.1). The two coefficients of place, rotation and angles are those that
    would have predicted the history best, as far as they differ little from those of a steady
    motion.

    Args:
        history: one pose or more.
        memory: deviation of the coefficients from those of a steady motion.
    """
    if len(history) < 2:
        return history[-1]
    steps = torch.stack([one.local(other).frame[0] for one, other in pairwise(history)])  # n D
    padded = torch.cat((steps.new_zeros(1, steps.shape[1]), steps))
    step = torch.zeros_like(steps[-1])
    for block in (slice(0, 3), slice(3, 6), slice(6, None)):
        own = padded[:, block]
        now, before = own[3:], torch.stack((own[2:-1], own[1:-2]), -1)
        coefficients = _regressed(now.flatten(), before.flatten(0, 1), memory)
        step[block] = torch.stack((own[-1], own[-2]), -1) @ coefficients
    return history[-1].retract(Step(step[None], step.new_zeros(0)))


def _regressed(now: Tensor, before: Tensor, memory: float) -> Tensor:
    """Coefficients (2,) of least squares, with a Gaussian about those of a steady motion."""
    steady = before.new_tensor([1.0, 0.0])
    error = now - before @ steady
    noise = error.square().mean() if len(error) else before.new_zeros(())
    precision = noise.clamp(min=1e-12) / memory**2 * torch.eye(2).to(before)
    better: Tensor = torch.linalg.solve(before.mT @ before + precision, before.mT @ error)
    return steady + better
