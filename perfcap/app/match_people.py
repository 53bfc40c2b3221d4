"""Which actor is which of the people found: by the lengths of their bones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from perfcap.actor.actor import Actor
from perfcap.detect.association import Association, bone_lengths, tracked_bones
from perfcap.detect.association.tracks import bone_difference

_CLEAR = 0.01  # of lengths, by which the next best choice should be worse
_FORBIDDEN = 1e6


@dataclass(frozen=True)
class Matching:
    """Who plays whom.

    Attributes:
        tracks: the found person of each actor.
        difference: of their bone lengths, root-mean-square of logarithms, a share.
        margin: how much worse all differences together get, root-mean-square, where an actor is
            another person; infinite where there is no other.
        notes: choices that are not clear.
    """

    tracks: tuple[int, ...]
    difference: tuple[float, ...]
    margin: tuple[float, ...]
    notes: tuple[str, ...]


UNMATCHED = Matching((), (), (), ())


def match_actors(actors: Sequence[Actor], found: Association, names: Sequence[str]) -> Matching:
    """Give each actor the person whose bones are as long, so that all together fit best.

    Args:
        actors: K.
        found: K people or more.
        names: of the actors, for notes.
    """
    own = torch.stack([bone_lengths(actor.skeleton.rest_landmarks) for actor in actors])
    apart = bone_difference(own[:, None].to(found.points), tracked_bones(found.points))
    cost = apart.detach().square().clamp(max=_FORBIDDEN).numpy()
    rows, columns = linear_sum_assignment(cost)
    best = cost[rows, columns].mean()
    margins = tuple(_next_best(cost, k, int(columns[k])) - math.sqrt(best) for k in rows)
    notes = tuple(
        f"--actor {names[k]}: somebody else's bones fit it almost as well (by "
        f"{100 * margin:.1f} % of their lengths); see overlay.mp4, and give actors of the people "
        "themselves"
        for k, margin in enumerate(margins)
        if margin < _CLEAR
    )
    chosen = cost[rows, columns]
    difference = tuple(float(math.sqrt(each)) for each in chosen)
    return Matching(tuple(int(c) for c in columns), difference, margins, notes)


def _next_best(cost: NDArray[np.float64], actor: int, person: int) -> float:
    """Root-mean-square difference of all, where an actor is not this person."""
    others = cost.copy()
    others[actor, person] = _FORBIDDEN
    rows, columns = linear_sum_assignment(others)
    mean = others[rows, columns].mean()
    return math.inf if mean >= _FORBIDDEN / len(cost) else math.sqrt(mean)
