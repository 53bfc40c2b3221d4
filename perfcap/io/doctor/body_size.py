"""How large a person is in the joints of a clip."""

from __future__ import annotations

import torch
from torch import Tensor


def body_size(joints: Tensor, known: Tensor) -> float | None:
    """The longer side of the box of the body in the median frame; None where no joint is known.

    Args:
        joints: landmarks (F, 16, D), in pixels or metres, which the size is in as well.
        known: which of them count, (F, 16).
    """
    low = joints.masked_fill(~known[..., None], torch.inf).amin(1)
    high = joints.masked_fill(~known[..., None], -torch.inf).amax(1)
    sizes = (high - low).amax(-1)
    sizes = sizes[sizes.isfinite() & (sizes > 0)]
    return float(sizes.median()) if len(sizes) else None
