"""True surfaces that contradict the true joints: other units, axes and frames."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from perfcap.metrics.lags import in_words, overlap

_INSIDE, _SLACK = 0.8, 0.1  # share of the joints in the surface's box, which is so much larger
_LARGER = 1.4  # than the joints from head to toe
_ENOUGH = 6  # joints of a frame, which span the person
_NEAREST = 20  # vertices that move with a joint
_LAGS = 10  # frames
_STEADIER, _LEAST = 0.5, 3e-3  # share of the movement against them that another frame leaves; m


def surface_mismatches(vertices: Tensor, joints: Tensor) -> tuple[str, ...]:
    """A sentence for each way in which a true surface is not one of its true joints.

    Args:
        vertices: (F, V, 3), metres, world; consecutive frames.
        joints: (F, J, 3), the same; not finite where unknown.
    """
    if not bool(joints.isfinite().all(-1).any()):
        return ()
    return tuple(_outside(vertices, joints)) or tuple(_late(vertices, joints))


def _outside(vertices: Tensor, joints: Tensor) -> Iterator[str]:
    low, high = vertices.amin(1), vertices.amax(1)
    known = joints.isfinite().all(-1)
    span = torch.where(known[..., None], joints, torch.nan)
    least = span.nan_to_num(nan=torch.inf).amin(1)
    most = span.nan_to_num(nan=-torch.inf).amax(1)
    seen = known.sum(1) >= _ENOUGH
    if not bool(seen.any()):
        return
    larger = float(((high - low)[seen].amax(-1) / (most - least)[seen].amax(-1)).median())
    slack = _SLACK * (most - least).amax(-1)[:, None]
    within = (joints > (low - slack)[:, None]) & (joints < (high + slack)[:, None])
    inside = float(within.all(-1)[known].double().mean())
    if not 1 / _LARGER < larger < _LARGER:
        yield (
            f"the true surface is {larger:.3g} times as large as its joints from end to end; "
            "expected metres"
        )
    elif inside < _INSIDE:
        yield (
            f"only {inside:.0%} of the true joints lie within the true surface; check that both "
            "have one world, axes and frames"
        )


def _late(vertices: Tensor, joints: Tensor) -> Iterator[str]:
    """How much joints move against the vertices next to them, of other frames as well."""
    middle = len(vertices) // 2
    known = joints.isfinite().all(-1).all(0).nonzero()[:, 0]
    if not len(known) or len(vertices) < 4:
        return
    followed = joints[:, known]
    count = min(_NEAREST, vertices.shape[1])
    near = torch.cdist(followed[middle], vertices[middle]).topk(count, largest=False).indices
    around = vertices[:, near].mean(2)
    now = _movement(around, followed)
    best, found = now, 0
    for lag in range(-_LAGS, _LAGS + 1):
        if lag == 0 or abs(lag) >= len(vertices) // 2:
            continue
        here, there = overlap(len(vertices), lag)
        moved = _movement(around[there], followed[here])
        if moved < best:
            best, found = moved, lag
    if best < _STEADIER * now and now - best > _LEAST:
        yield (
            f"the true surface of {in_words(found)} fits the true joints better; check the numbers "
            "of its frames"
        )


def _movement(around: Tensor, joints: Tensor) -> float:
    """Mean change of the distance between joints and what moves with them, m."""
    apart = joints - around
    return float((apart.norm(dim=-1) - apart.norm(dim=-1).median(0).values).abs().mean())
