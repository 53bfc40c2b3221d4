"""Which foot points stand in which frames, from the motion itself."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from perfcap.pipeline.floor import Floor, velocity

# Logistic regression on 28 captures of 14 clips of the CMU library (one view with 3D joints and
# four views), labels from the recorded motion: a point stands below 4.5 cm and 0.4 m/s. Features:
# height (m), log of horizontal speed in the clip's noise, log of vertical speed (m/s), height
# above the lowest point (m), ten times height squared (m^2), one.
_LOG_ODDS = (-8.16, -1.40, -1.38, -4.71, -8.50, -0.88)
_CORRELATED = 0.5  # of the evidence of a frame that is not in its neighbours' already
_SWITCHES = 4.0  # times a second that a point lands or leaves, at most
_FLOORED, _RAISED = -0.1, 0.3  # m, between which heights count


def contact_probability(soles: Tensor, floor: Floor, rate: float) -> Tensor:
    """Probability that each point stands in each frame, (F, N).

    A hidden Markov model of two states a point, standing and moving: their log odds in a frame come
    from height and speed, and changing the state has its price, so that a point that stands keeps
    standing through a doubtful frame (hysteresis). Forward-backward gives the probabilities.

    Args:
        soles: points under the feet, (F, N, 3), metres.
        floor: that they stand on.
        rate: frames a second.
    """
    height = floor.above(soles)
    speed = velocity(soles, rate)
    vertical = speed @ floor.normal
    level = (speed - vertical[..., None] * floor.normal).norm(dim=-1)
    noise = speed.norm(dim=-1).amin(-1).median()
    near = height.clamp(_FLOORED, _RAISED)
    features = (
        near,
        ((level + 0.05) / (noise + 0.1)).log().clamp(-2, 4),
        (vertical.abs() + 0.05).log(),
        (height - height.amin(-1, keepdim=True)).clamp(max=_RAISED),
        10 * near.square(),
        torch.ones_like(near),
    )
    odds = sum(w * x for w, x in zip(_LOG_ODDS, features, strict=True))
    assert isinstance(odds, Tensor)
    return _two_states(_CORRELATED * odds, min(0.5, _SWITCHES / rate))


def _two_states(odds: Tensor, switch: float) -> Tensor:
    """Posterior of the first of two states, (F, N), from log odds a frame and a rate of change."""
    frames = len(odds)
    emit = torch.stack(
        (torch.nn.functional.logsigmoid(odds), torch.nn.functional.logsigmoid(-odds))
    )
    stay, leave = math.log1p(-switch), math.log(switch)

    def moved(state: Tensor) -> Tensor:
        return torch.stack(
            (
                torch.logaddexp(state[0] + stay, state[1] + leave),
                torch.logaddexp(state[0] + leave, state[1] + stay),
            )
        )

    forward, backward = [emit[:, 0]], [torch.zeros_like(emit[:, 0])]
    for frame in range(1, frames):
        forward.append(moved(forward[-1]) + emit[:, frame])
        backward.append(moved(backward[-1] + emit[:, frames - frame]))
    both = torch.stack(forward, 1) + torch.stack(backward[::-1], 1)
    return torch.sigmoid(both[0] - both[1])
