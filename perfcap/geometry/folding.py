"""Where a deformed surface has folded over itself or has been crushed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

CHUNK = 8  # frames at once, so that memory does not grow with them


@dataclass(frozen=True)
class Folding:
    """Triangles that a deformation has spoilt.

    Attributes:
        flipped: turned over relative to the surface before, (*b, F, T) bool.
        collapsed: left with next to no area, (*b, F, T) bool.
        share: area before of what is either, as a share of the whole surface, (*b, F).
    """

    flipped: Tensor
    collapsed: Tensor
    share: Tensor

    @property
    def count(self) -> Tensor:
        """Triangles of a frame that are either, (*b, F)."""
        return (self.flipped | self.collapsed).sum(-1)


def find_folds(
    posed: Tensor,
    deformed: Tensor,
    faces: Tensor,
    turn: float = math.pi / 2,
    least_area: float = 0.1,
) -> Folding:
    """Compare every triangle with itself before a deformation.

    A refinement moves cloth by centimetres; a triangle that looks the other way afterwards, or is
    hardly there, has been pulled over its neighbours. A whole limb turned by more than ``turn``
    counts as well: no refinement should. Triangles that had no area are never spoilt; coordinates
    that are not finite always are. Slivers flip easily and count little in ``share``.

    Args:
        posed: before, (*b, F, V, 3), metres.
        deformed: after, (*b, F, V, 3), metres.
        faces: (T, 3).
        turn: largest angle between a normal before and after, radians.
        least_area: smallest area after, as a share of that before.
    """
    lead = posed.shape[:-2]
    before, after = (x.detach().reshape(-1, *x.shape[-2:]) for x in (posed, deformed))
    pairs = zip(torch.split(before, CHUNK), torch.split(after, CHUNK), strict=True)
    chunks = [_compare(*pair, faces, math.cos(turn), least_area) for pair in pairs]
    flipped, collapsed, share = (torch.cat(part) for part in zip(*chunks, strict=True))
    shape = (*lead, len(faces))
    return Folding(flipped.reshape(shape), collapsed.reshape(shape), share.reshape(lead))


def _compare(
    before: Tensor, after: Tensor, faces: Tensor, least_cosine: float, least_area: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Flipped and collapsed triangles (f, T), and the share of area that is either (f,)."""
    old, new = _doubled_normals(before, faces), _doubled_normals(after, faces)
    old_area, new_area = old.norm(dim=-1), new.norm(dim=-1)
    real = old_area > 0
    # asked so that NaN answers no
    sound = (old * new).sum(-1) >= least_cosine * old_area * new_area
    flipped = real & ~sound
    collapsed = real & ~(new_area >= least_area * old_area)
    spoilt = (flipped | collapsed).to(old_area)
    total = old_area.sum(-1).clamp_min(torch.finfo(old_area.dtype).tiny)
    return flipped, collapsed, (spoilt * old_area).sum(-1) / total


def _doubled_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Normals of triangles, twice as long as their areas, (f, T, 3)."""
    a, b, c = (vertices[:, faces[:, corner]] for corner in range(3))
    normals: Tensor = torch.linalg.cross(b - a, c - a)
    return normals
