"""Smooth motions as a linear subspace: the lowest cosines of a window, and what they leave out.

The basis is the orthonormal type-II discrete cosine transform,

    C[k, f] = s_k cos(pi k (2 f + 1) / (2 F)),   s_0 = sqrt(1 / F),  s_k = sqrt(2 / F),

whose rows are orthonormal. Xu et al. 2018 (Eq. 7) keep K = 8 of F = 50.
"""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.setting_checks import require_count


def dct_basis(
    frames: int,
    rank: int | None = None,
    dtype: torch.dtype | None = None,
    device: torch.device | str | None = None,
) -> Tensor:
    """The ``rank`` smoothest vectors of the orthonormal DCT-II over a window, (K, F).

    Args:
        frames: F, at least 1.
        rank: K, 1 to F; all F if None.
        dtype: of the result (computed in float64); torch's default if None.
        device: of the result.

    Raises:
        InputError: there are no such frames, no such rank of them, or ``dtype`` has no fractions.
    """
    if dtype is not None and not dtype.is_floating_point:
        raise InputError(f"dtype is {dtype}, expected one of floating-point numbers")
    require_count(frames, "frames")
    rank = frames if rank is None else rank
    require_count(rank, "rank")
    if not 1 <= rank <= frames:
        raise InputError(f"rank is {rank} for {frames} frames; give 1 <= rank <= frames")
    order = torch.arange(rank)[:, None]
    # the cosine's period is 4F steps: reduced in integers, high orders lose no digits
    steps = (order * (2 * torch.arange(frames) + 1)) % (4 * frames)
    basis: Tensor = (2 / frames) ** 0.5 * (steps.double() * (torch.pi / (2 * frames))).cos()
    basis[0] = (1 / frames) ** 0.5
    return basis.to(device=device, dtype=dtype or torch.get_default_dtype())


def project(values: Tensor, basis: Tensor) -> Tensor:
    """Part of trajectories (*b, F, E) inside the span of orthonormal rows (K, F): the smooth part.

    A projection: symmetric, and applying it twice changes nothing.
    """
    return basis.mT @ (basis @ values)


def project_out(values: Tensor, basis: Tensor) -> Tensor:
    """Part of trajectories (*b, F, E) in the null space of orthonormal rows (K, F).

    The trajectory prior of Xu et al. 2018, Eq. 7, penalises exactly this part.
    """
    return values - project(values, basis)
