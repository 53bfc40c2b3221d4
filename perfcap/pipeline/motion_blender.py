"""One motion of overlapping windows."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.temporal.window import Blender, Window, mean_rotations, mean_vectors


class MotionBlender:
    """Blends solved windows: linear in the overlaps, on SO(3) for the root (MPC-9).

    Holds the windows that the next one may overlap, and the finished frames.
    """

    def __init__(self) -> None:
        means = (mean_vectors, mean_rotations, mean_vectors)
        self._blenders = [Blender(mean) for mean in means]
        self._done: list[list[Tensor]] = [[], [], []]

    def push(self, window: Window, solved: Motion) -> None:
        """Take the motion of the next window, (W,)."""
        values = (solved.translation, solved.rotation, solved.angles)
        for blender, done, value in zip(self._blenders, self._done, values, strict=True):
            done.append(blender.push(window, value))

    def finish(self, skeleton: Skeleton) -> Motion:
        """The whole motion, (F,), every angle within the skeleton's limits."""
        for blender, done in zip(self._blenders, self._done, strict=True):
            done.append(blender.finish())
        translation, rotation, angles = (torch.cat(done) for done in self._done)
        # a mean of bounded angles is bounded; only its rounding can be a bit outside
        return Motion(translation, rotation, angles.clamp(skeleton.lower, skeleton.upper))
