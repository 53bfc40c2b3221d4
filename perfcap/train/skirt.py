"""Skirts and coats: cloth that hangs around hips and legs.

Nothing is simulated. Around the axis of the pelvis, at every height, cloth is as wide as the legs
there push it, and never narrower than above: it falls straight from the widest place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.anatomy import JOINTS
from perfcap.train.figure import Figure

Floats = NDArray[np.float32]

_AROUND, _DOWN = 48, 14  # vertices around and down
_CLEARANCE = 0.012  # m between body and cloth
_BODY = tuple(
    JOINTS.index(n)
    for n in ("pelvis", "l_hip", "r_hip", "l_knee", "r_knee")
)  # fmt: skip


@dataclass(frozen=True)
class Skirt:
    """A cut.

    Attributes:
        rise: of its waist above the middle of the hips, m.
        length: from the waist down, m.
        flare: how much wider it gets, m a metre.
        folds: how many.
        depth: of the folds at the hem, m.
        phase: of the folds, rad.
        sway: of the hem, ahead and to the left, m.
    """

    rise: float
    length: float
    flare: float
    folds: int
    depth: float
    phase: float
    sway: tuple[float, float]


def random_skirt(rng: np.random.Generator) -> Skirt:
    """From mini to floor length, from pencil to circle."""
    return Skirt(
        rise=float(rng.uniform(0.0, 0.18)),
        length=float(rng.uniform(0.4, 1.0)),
        flare=float(rng.uniform(0.0, 0.32)),
        folds=int(rng.integers(4, 13)),
        depth=float(rng.uniform(0.0, 0.045)),
        phase=float(rng.uniform(0, 6.3)),
        sway=(float(rng.normal(0, 0.04)), float(rng.normal(0, 0.04))),
    )


def hang(skirt: Skirt, figure: Figure, surface: Tensor, hips: Tensor, turn: Tensor) -> Tensor:
    """Vertices (K, 3) of a skirt on a posed figure, row by row from the waist down.

    Args:
        skirt: its cut.
        figure: who wears it.
        surface: posed vertices (V, 3), world, m.
        hips: the middle of the hips, (3,).
        turn: of the pelvis in the world, (3, 3).
    """
    worn = torch.isin(figure.owner, torch.tensor(_BODY))
    local = ((surface[worn] - hips) @ turn).numpy()  # x left, y up, z ahead of the pelvis
    radius = _radii(local, skirt)
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    down = np.linspace(0, 1, _DOWN)[:, None]
    radius += skirt.flare * skirt.length * down
    radius += skirt.depth * down * np.sin(skirt.folds * angle + skirt.phase)
    x = radius * np.cos(angle) + skirt.sway[1] * down**2
    z = radius * np.sin(angle) + skirt.sway[0] * down**2
    y = np.broadcast_to(skirt.rise - skirt.length * down, x.shape)
    points = torch.from_numpy(np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32))
    return points @ turn.T + hips


def skirt_mesh() -> tuple[Tensor, Tensor]:
    """Faces (T, 3) and texture places (K, 2) of any skirt; the texture runs around and down."""
    row, column = (v.ravel() for v in np.mgrid[: _DOWN - 1, :_AROUND])
    right = (column + 1) % _AROUND
    a, b = row * _AROUND + column, row * _AROUND + right
    c, d = a + _AROUND, b + _AROUND
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    down, around = np.divmod(np.arange(_DOWN * _AROUND), _AROUND)
    # there and back again, so that the texture has no seam
    across = 1 - np.abs(2 * around / _AROUND - 1)
    uv = np.stack([across, down / (_DOWN - 1)], -1).astype(np.float32)
    return torch.from_numpy(faces), torch.from_numpy(uv)


def skirt_ahead() -> Tensor:
    """Faces (T,) that are before the wearer."""
    before = torch.arange(_AROUND) < _AROUND // 2
    return before.repeat(_DOWN - 1).repeat(2)


def _radii(local: Floats, skirt: Skirt) -> NDArray[np.float64]:
    """How far legs push cloth at each height and in each direction, (down, around), m."""
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    out = np.stack([np.cos(angle), np.sin(angle)])
    reach = local[:, [0, 2]] @ out
    level = (skirt.rise - local[:, 1]) / skirt.length * (_DOWN - 1)
    radius = np.full((_DOWN, _AROUND), 0.06)
    for row in range(_DOWN):
        here = np.abs(level - row) < 1
        if here.any():
            radius[row] = np.maximum(radius[row], reach[here].max(0) + _CLEARANCE)
    widest: NDArray[np.float64] = np.maximum.accumulate(radius, 0)
    return widest
