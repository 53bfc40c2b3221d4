"""Feet of robots on the floor, with the whole of their shapes.

Four points stand for a sole in the solve of ``retarget``; corners of a foot that is rolled may be
below them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion

_ALLOWED = 0.004  # m below the floor that are left
_TIME = 0.05  # s over which a lift comes and goes


def above_floor(actor: Actor, motion: Motion, rate: float) -> Motion:
    """The motion lifted where a foot's lowest vertex is below y = 0, smoothly in time.

    Four points stand for the sole in the solve; corners of a foot that is rolled may be below them.

    Args:
        actor: with a mesh, standing along y.
        motion: (F,).
        rate: frames a second.
    """
    depth = (-_lowest(actor, motion) - _ALLOWED).clamp(min=0).double().numpy(force=True)
    if not depth.any():
        return motion
    width = max(1, round(_TIME * rate))
    # the mean of what is at least the depth within three widths is nowhere below it
    most = maximum_filter1d(depth, 2 * 3 * width + 1, mode="nearest")
    lift = gaussian_filter1d(most, width, truncate=3.0, mode="nearest")
    up = np.stack((np.zeros_like(lift), lift, np.zeros_like(lift)), -1)
    return replace(motion, translation=motion.translation + torch.tensor(up).to(motion.translation))


def grounded(actor: Actor, motion: Motion) -> Motion:
    """The motion moved along y so that its feet touch y = 0 at their lowest, (F,).

    For clips in which feet stand on no floor that is found: simulators have theirs there.
    """
    lowest = _lowest(actor, motion).min()
    if not torch.isfinite(lowest):
        return motion
    up = motion.translation.new_tensor([0.0, 1.0, 0.0])
    return replace(motion, translation=motion.translation - lowest * up)


def _lowest(actor: Actor, motion: Motion) -> Tensor:
    """Height of the lowest vertex of the feet, (F,), metres."""
    rig = actor.skeleton.rig
    feet = {rig.landmark_joints[rig.landmarks.index(f"{side}_toe")] for side in "lr"}
    for joint, parent in enumerate(rig.parents):
        feet |= {joint} if parent in feet else set()
    rotation, translation = actor.joint_transforms(motion)
    owner = actor.skin.rows()[2]
    lowest = motion.angles.new_full((motion.frames,), torch.inf)
    for joint in sorted(feet):
        vertices = actor.vertices[owner == joint].to(rotation)
        if len(vertices):
            heights = (
                vertices @ rotation[:, joint, 1, :, None] + translation[:, joint, 1, None, None]
            )
            lowest = torch.minimum(lowest, heights.amin((-2, -1)))
    return lowest
