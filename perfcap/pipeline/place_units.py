"""Whether places of a motion are in the world, in the unit and axes of its bones: feet say so."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product
from typing import Self

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
# the same, a second of steps: for as long as a swing, legs that dangle from a root that hardly
# moves fit some factor
_SURE = 0.4
# feet of 34 recorded motions slide by 0.85 of the hips' way at most, and by 0.04 to 0.5 of 32 of
# them; by 1.2 to 2.2 where the axis along which the person walks is another
_SLIDES = 1.1
_STAYS = 1e-6  # of the legs: what turning a world leaves of one place
_NEAR = 0.1  # of the hips' way: axes that explain it as well, of which the fewest changes are told


def place_doubts(
    landmarks: Tensor, rate: float, legs: float, root: Tensor | None = None
) -> Iterator[str]:
    """A sentence where places look relative to the pelvis, or of another unit or axes than bones.

    While hips go over a foot, the foot stays where it is. Hips seen from the foot go by lengths
    of bones, hips in the world by their places: of the root in files, about which the pelvis turns
    by its bones, and of the middle of the hips in what was made from predicted poses.

    Args:
        landmarks: (F, 16, 3) with y up, metres by the unit of the bones.
        rate: frames a second.
        legs: length of the legs, metres.
        root: what the source's places are of, (F, 3) m; the middle of the hips if None.
    """
    landmarks = landmarks.detach()
    steps = _Steps.of(landmarks, mid_hip(landmarks), rate, legs)
    if steps is None:  # as of who climbs or walks on the spot
        return
    factor, axes = steps.factor(), steps.axes()
    placed = None if root is None else root.detach().to(landmarks)
    if placed is not None and float((placed - placed[0]).abs().max()) <= _STAYS * legs:
        yield (
            "the pelvis stays at one place to the last digit while feet walk below it, as where "
            "each frame's pelvis was subtracted from its joints, or a file has no positions of its "
            "root: give joints in the world, unless the motion was made to stay on the spot"
        )
        return
    by_root = None if placed is None else _Steps.of(landmarks, placed, rate, legs)
    if by_root is not None:
        stands = min(_STANDS, _SURE * len(by_root.gone) / rate)
        factor, axes = by_root.factor(stands) or factor, by_root.axes() or axes
    if factor is not None:
        yield (
            f"feet would stand if the source's places were {factor:.3g} times as large, and slide "
            "as they are; its root looks to be in another unit than its bones: export both in one"
        )
    elif axes is not None:
        yield (
            f"feet would stand if the source's places were ({', '.join(axes)}) for (x, y, z), and "
            "slide as they are; its root looks to have other axes than its bones, as where one "
            "was mirrored: export both in the same"
        )


@dataclass(frozen=True)
class _Steps:
    """Steps of hips over the lowest foot, N of them, metres.

    Attributes:
        gone: by which the point went that places are of, (N, 3).
        foot: by which the foot went, seen from that point, (N, 3).
        way: by which hips went over the foot, (N,).
    """

    gone: Tensor
    foot: Tensor
    way: Tensor

    @classmethod
    def of(cls, landmarks: Tensor, placed: Tensor, rate: float, legs: float) -> Self | None:
        """Those of a motion by a point (F, 3) of it; None where there are hardly any."""
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
        swing = hips - placed  # by bones: as large in whatever unit places are
        foot = over + swing[step:] - swing[:-step]
        return cls((placed[step:] - placed[:-step])[moves], foot[moves], way[moves])

    def slide(self, gone: Tensor) -> float:
        """Share of the hips' way over it by which the foot slides, median, if places went so."""
        return float(((gone + self.foot).norm(dim=-1) / self.way).median())

    def factor(self, stands: float = _STANDS) -> float | None:
        """By what places are too small; None where they fit, or no foot ``stands`` by another."""
        most = math.log(_LARGEST)
        factors = torch.linspace(-most, most, _TRIED).exp().tolist()
        left = [self.slide(factor * self.gone) for factor in factors]
        best = factors[left.index(min(left))]
        fits = min(left) < min(stands, _BETTER * self.slide(self.gone))
        return best if fits and not 1 / _OTHER < best < _OTHER else None

    def axes(self) -> tuple[str, ...] | None:
        """What x, y and z should be, such as ("-x", "y", "z"); None as of ``factor``."""
        if self.slide(self.gone) < _SLIDES:
            return None
        tried = []
        for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
            left = self.slide(self.gone[:, list(order)] * self.gone.new_tensor(signs))
            pairs = zip(order, signs, strict=True)
            names = tuple(("" if sign > 0 else "-") + "xyz"[axis] for axis, sign in pairs)
            tried.append((left, sum(n != a for n, a in zip(names, "xyz", strict=True)), names))
        least = min(tried)[0]
        if least > _STANDS:
            return None
        near = (each for each in tried if each[0] < least + _NEAR)
        return min(near, key=lambda each: (each[1], each[0]))[2]
