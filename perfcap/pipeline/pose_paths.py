"""Poses of frames one after another, for skeletons that reach a pose in several ways.

Hinges of robots turn freely about straight limbs, and their limits divide what a person's arm may
do in one sweep into ways that do not meet. Frames solved on their own jump between them. Here a
path of poses is followed from frame to frame; where it runs into a limit that another way avoids,
a second path is begun there, and the cheapest way through all paths is taken (Viterbi 1967).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.energy.prior import PosePrior
from perfcap.pipeline.retarget_rows import Rows
from perfcap.solve.energy import Energy

Solve = Callable[[dict[str, Energy[Motion]], Motion], Motion]

_SETTLED = 5  # solves of the first pose of a path
_EXCESS = 25.0  # squared deviations above which another way is looked for
_PATHS = 4


def in_turn(rows: Rows, begun: Motion, alone: Motion, still: float, solved: Solve) -> Motion:
    """Poses that follow one another, (F,).

    Args:
        rows: what every frame is asked for.
        begun: where the root starts in every frame, and the angles of the first, (F,).
        alone: every frame solved on its own, (F,).
        still: deviation of an angle from the frame before, radians.
        solved: the poses (N, W) of least energy near given ones.
    """
    paths = [_path(rows, begun, begun.angles[0], 0, still, solved)]
    least = _energy(rows, alone)
    while len(paths) < _PATHS:
        excess = torch.stack([_energy(rows, path) for path in paths]).amin(0) - least
        worst = int(excess.argmax())
        if not excess[worst] > _EXCESS:
            break
        paths.append(_path(rows, begun, alone.angles[worst], worst, still, solved))
    return _cheapest(rows, paths, still)


def _path(
    rows: Rows, begun: Motion, angles: Tensor, start: int, still: float, solved: Solve
) -> Motion:
    """Poses from one frame on, in both directions."""
    parts: dict[int, Motion] = {}
    for frame in (*range(start, begun.frames), *reversed(range(start))):
        index = torch.tensor([[frame]])
        near = parts.get(frame - 1 if frame > start else frame + 1)
        state = begun.map(lambda each, index=index: each[index])
        state = replace(state, angles=angles[None, None] if near is None else near.angles)
        for _ in range(_SETTLED if near is None else 1):
            rest = PosePrior(state.angles[0, 0], still)
            state = solved({"pose": rows.energy(index), "still": rest}, state)
        parts[frame] = state
    return Motion.cat([parts[n].map(lambda each: each[0]) for n in range(begun.frames)])


def _energy(rows: Rows, motion: Motion) -> Tensor:
    """What every pose leaves of what it is asked for, (F,)."""
    index = torch.arange(motion.frames)[:, None]
    energy: Tensor = rows.energy(index)(motion.map(lambda each: each[index]))
    return energy


def _cheapest(rows: Rows, paths: list[Motion], still: float) -> Motion:
    """The way through all paths that pays least for its poses and for changes of angles."""
    if len(paths) == 1:
        return paths[0]
    cost = torch.stack([_energy(rows, path) for path in paths])  # P F
    angles = torch.stack([path.angles for path in paths])  # P F A
    total, came = cost[:, 0], []
    for frame in range(1, cost.shape[1]):
        step = (angles[:, None, frame] - angles[None, :, frame - 1]) / still
        best, before = (total + step.square().sum(-1)).min(1)
        total = best + cost[:, frame]
        came.append(before)
    way = [int(total.argmin())]
    for before in reversed(came):
        way.append(int(before[way[-1]]))
    way.reverse()
    return Motion.cat([paths[path][n : n + 1] for n, path in enumerate(way)])
