"""Poses of frames one after another, for skeletons that reach a pose in several ways.

Hinges of robots turn freely about straight limbs, and their limits divide what a person's arm may
do in one sweep into ways that do not meet. Frames solved on their own jump between them. Here a
path of poses is followed from frame to frame; where it runs into a limit that another way avoids,
a second path is begun there, and the cheapest way through all paths is taken (Viterbi 1967).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.energy.prior import PosePrior
from perfcap.pipeline.retarget_rows import Rows
from perfcap.solve.energy import Energy

Solve = Callable[[dict[str, Energy[Motion]], Motion, float], Motion]

_SETTLED = 5  # solves of the first pose of a path
_EXCESS = 25.0  # squared deviations above which another way is looked for
_PATHS = 4
_ROUNDING = 1e-4  # rad
_NEVER = 1e12


@dataclass(frozen=True)
class Pace:
    """How angles go from frame to frame, radians.

    Attributes:
        still: deviation of a change.
        most: the largest change.
    """

    still: float
    most: float


def in_turn(rows: Rows, begun: Motion, alone: Motion, pace: Pace, solved: Solve) -> Motion:
    """Poses that follow one another, (F,).

    Args:
        rows: what every frame is asked for.
        begun: where the root starts in every frame, and the angles of the first, (F,).
        alone: every frame solved on its own, (F,).
        pace: of the angles.
        solved: the poses (N, W) of least energy, whose angles are within so many radians of given
            ones.
    """
    paths = [_path(rows, begun, begun.angles[0], 0, pace, solved)]
    least = _energy(rows, alone)
    while len(paths) < _PATHS:
        excess = torch.stack([_energy(rows, path) for path in paths]).amin(0) - least
        worst = int(excess.argmax())
        if not excess[worst] > _EXCESS:
            break
        paths.append(_path(rows, begun, alone.angles[worst], worst, pace, solved))
    return _cheapest(rows, paths, pace)


def paced(motion: Motion, most: float) -> Motion:
    """The motion (F,) with angles that follow by at most so many radians a frame."""
    angles = [motion.angles[0]]
    for wanted in motion.angles[1:]:
        angles.append(torch.clamp(wanted, angles[-1] - most, angles[-1] + most))
    return replace(motion, angles=torch.stack(angles))


def _path(
    rows: Rows, begun: Motion, angles: Tensor, start: int, pace: Pace, solved: Solve
) -> Motion:
    """Poses from one frame on, in both directions."""
    parts: dict[int, Motion] = {}
    for frame in (*range(start, begun.frames), *reversed(range(start))):
        index = torch.tensor([[frame]])
        near = parts.get(frame - 1 if frame > start else frame + 1)
        state = begun.map(lambda each, index=index: each[index])
        state = replace(state, angles=angles[None, None] if near is None else near.angles)
        for _ in range(_SETTLED if near is None else 1):
            still = PosePrior(state.angles[0, 0], pace.still)
            reach = math.inf if near is None else pace.most
            state = solved({"pose": rows.energy(index), "still": still}, state, reach)
        parts[frame] = state
    return Motion.cat([parts[n].map(lambda each: each[0]) for n in range(begun.frames)])


def _energy(rows: Rows, motion: Motion) -> Tensor:
    """What every pose leaves of what it is asked for, (F,)."""
    index = torch.arange(motion.frames)[:, None]
    energy: Tensor = rows.energy(index)(motion.map(lambda each: each[index]))
    return energy


def _cheapest(rows: Rows, paths: list[Motion], pace: Pace) -> Motion:
    """The way through all paths that pays least for its poses and for changes of angles."""
    if len(paths) == 1:
        return paths[0]
    cost = torch.stack([_energy(rows, path) for path in paths])  # P F
    angles = torch.stack([path.angles for path in paths])  # P F A
    total, came = cost[:, 0], []
    for frame in range(1, cost.shape[1]):
        step = (angles[:, None, frame] - angles[None, :, frame - 1]).abs()
        change = (step / pace.still).square().sum(-1)
        change = change + _NEVER * (step.amax(-1) > pace.most + _ROUNDING)
        best, before = (total + change).min(1)
        total = best + cost[:, frame]
        came.append(before)
    way = [int(total.argmin())]
    for before in reversed(came):
        way.append(int(before[way[-1]]))
    way.reverse()
    return Motion.cat([paths[path][n : n + 1] for n, path in enumerate(way)])
