"""Following one person through frames in which a detector found several."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from perfcap.io.detections.track import Array

# How far a person's joints may move from frame to frame, as a share of their own size, and how
# much more for every frame in which they were not seen.
STEP = 0.5
STEP_PER_GAP = 0.1


def follow(frames: Sequence[Sequence[Array]]) -> Array:
    """The joints (F, J, 3) of one person; zeros in frames where they were not detected.

    Starts at the largest, most confident person of the clip and follows them both ways: in each
    frame the nearest candidate, unless even that one is too far away to be the same person.

    Args:
        frames: per frame the candidates, each (J, 3): x, y, confidence; at least one in all.
    """
    scores = [[prominence(person) for person in people] for people in frames]
    best = [max(people, default=-np.inf) for people in scores]
    start = int(np.argmax(best))
    first = frames[start][int(np.argmax(scores[start]))]
    chosen = np.zeros((len(frames), *first.shape))
    chosen[start] = first
    _walk(frames, chosen, first, range(start + 1, len(frames)))
    _walk(frames, chosen, first, range(start - 1, -1, -1))
    return chosen


def _walk(
    frames: Sequence[Sequence[Array]], chosen: Array, last: Array, order: Iterable[int]
) -> None:
    gap = 0
    for f in order:
        distances = [_distance(person, last) for person in frames[f]]
        nearest = int(np.argmin(distances)) if distances else -1
        if nearest >= 0 and distances[nearest] < STEP + STEP_PER_GAP * gap:
            last = chosen[f] = frames[f][nearest]
            gap = 0
        else:
            gap += 1


def _seen(person: Array) -> Array:
    finite = np.where(np.isfinite(person), person, 0)
    points: Array = finite[finite[:, 2] > 0]
    return points


def _extent(person: Array) -> float:
    points = _seen(person)[:, :2]
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def prominence(person: Array) -> float:
    """Size times summed confidence of a person (J, 3): large and well seen."""
    points = _seen(person)
    return _extent(person) * float(points[:, 2].sum()) if len(points) else 0.0


def _distance(person: Array, other: Array) -> float:
    """Median distance of the joints both have, as a share of the other's size."""
    both = np.isfinite(person).all(-1) & np.isfinite(other).all(-1)
    both &= (person[:, 2] > 0) & (other[:, 2] > 0)
    size = _extent(other)
    if not both.any() or size == 0:
        return float("inf")
    steps = np.linalg.norm(person[both, :2] - other[both, :2], axis=-1)
    return float(np.median(steps)) / size
