"""Whether places of a motion have the unit of its bones: feet that stand say so."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip

_FEET = [LANDMARKS.index(name) for name in ("l_ankle", "r_ankle", "l_toe", "r_toe")]
_STEP = 0.1  # s, over which motion is looked at
_STEPS = 0.03  # of the legs: by which hips go over a foot, at least, within that
_FEWEST = 15  # frames in which they do
_LARGEST, _TRIED = 1000.0, 277  # factors, of places
# of 20 recorded motions whose feet stand (2 to 44 % of the hips' way over them at least) factors
# are 0.78 to 1.05, and with other units of places 2.0 and more, or 0.41 and less
_OTHER = 1.8
_STANDS, _BETTER = 0.5, 0.6  # of the hips' way, and of the given places', that a foot slides


def places_factor(landmarks: Tensor, rate: float, legs: float) -> float | None:
    """By what places of a person are too small, if the foot that stands says that they are.

    While hips go over a foot, the foot stays where it is. Hips seen from the foot go by lengths
    of bones, hips in the world by their places.

    Args:
        landmarks: (F, 16, 3) with y up, metres by the unit of the bones.
        rate: frames a second.
        legs: length of the legs, metres.

    Returns:
        None where places fit, or where feet hardly stand, as of who climbs or walks on the spot.
    """
    step = max(1, round(_STEP * rate))
    hips = mid_hip(landmarks)
    feet = landmarks[:, _FEET] - hips[:, None]
    if len(hips) <= step:
        return None
    lowest = (feet[step:, :, 1] + feet[:-step, :, 1]).argmin(1)
    over = (feet[step:] - feet[:-step])[torch.arange(len(lowest)), lowest]
    way = over.norm(dim=-1)
    moves = way > _STEPS * legs
    if int(moves.sum()) < _FEWEST:
        return None
    gone = (hips[step:] - hips[:-step])[moves]
    over, way = over[moves], way[moves]

    def slides(factor: Tensor) -> Tensor:
        shares: Tensor = (factor * gone + over).norm(dim=-1) / way
        return shares.median()

    most = math.log(_LARGEST)
    factors = torch.linspace(-most, most, _TRIED).to(way).exp()
    left = torch.stack([slides(factor) for factor in factors])
    best = float(factors[left.argmin()])
    fits = float(left.min()) < min(_STANDS, _BETTER * float(slides(torch.ones_like(way[0]))))
    return best if fits and not 1 / _OTHER < best < _OTHER else None
