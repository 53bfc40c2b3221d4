"""Poses of a moving camera that stay for a few frames at a time, as where each n-th was solved."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np
import torch

from perfcap.io.calibration import CameraRig
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.ways import given_ways

_FEWEST = 3  # stretches of frames with one pose
_MOST_ARE = 0.7  # share of the poses that stay for two frames or more


def examine_held_poses(rig: CameraRig) -> Iterator[Finding]:
    """Views whose pose is that of the frame before, to the last digit, again and again.

    A camera that rests for a while and moves on has one pose in many frames, and then others in one
    each.

    Args:
        rig: C views.
    """
    for way in given_ways(rig):
        turns, shifts = (part.diff(dim=0) != 0 for part in (way.rotation, way.translation))
        moves = turns.any(-1).any(-1) | shifts.any(-1)
        poses = torch.cat((moves.new_zeros(1), moves)).cumsum(0).tolist()
        lengths = [len(list(frames)) for _, frames in groupby(poses)]
        held = [length for length in lengths if length > 1]
        if len(held) < _FEWEST or len(held) < _MOST_ARE * len(lengths):
            continue
        what = (
            f"its pose stays the same to the last digit for {np.median(held):.0f} frames at a time "
            f"(in {sum(held) - len(held)} of {len(poses)}), and then is another"
        )
        remedy = (
            "were every few images solved alone? Solve all of them, or give the others poses "
            "between; if the camera rests, give one pose"
        )
        yield Finding(Severity.WARNING, way.name, what, remedy)
