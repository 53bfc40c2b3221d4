"""What the evidence of a frame says of its errors: weights fitted to captures with a truth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

FEATURES = (
    "pixels", "worst_pixels", "support", "least_support", "space", "worst_space", "no_space",
    "spread", "views", "deviation",
)  # fmt: skip
SEVERAL = math.log(2.5)
"""Of one plus the number of views that see the person: above this, two or more do."""


@dataclass(frozen=True)
class _Weights:
    """Of the evidence, the last number a constant.

    Attributes:
        bad: logistic regression of bad frames.
        error: linear regression of the log error, millimetres.
    """

    bad: tuple[float, ...]
    error: tuple[float, ...]


# 6760 frames of captures of 14 clips of the CMU library, in one, two and six simulated views, with
# usual and with 2.2 times the errors, parts hidden, without 3D poses. Nothing said there how far 3D
# poses may be off.
_ONE_VIEW = _Weights(
    (-0.398, 1.12, -0.111, -0.43, 1.699, 0.086, 2.947, 0.252, -1.724, 0.0, 0.953),
    (-0.196, 0.421, -0.68, -0.112, 0.571, -0.061, 0.749, 0.088, -0.735, 0.0, 5.169),
)
# Where something says how far they may be off: 3024 frames of 84 videos of rendered people,
# captured from the video alone; a tenth of the good frames is named (experiments/trust_video.py).
_LIFTED = _Weights(
    (0.278, 0.182, -1.126, 0.007, 0.259, 0.661, 0.067, 0.232, -0.874, 1.033, 4.61),
    (0.126, 0.051, -0.368, -0.005, -0.186, 0.238, -0.124, 0.058, 0.688, 0.496, 5.377),
)
# 46 844 frames of captures of the library's clips in two to six simulated views, with usual and
# with 2.2 times the errors, parts hidden, or a view wrong for a while, with and without 3D poses;
# one in 25 of the good frames is named (experiments/trust_views.py).
_SEVERAL_VIEWS = _Weights(
    (-0.331, 2.253, -3.592, -0.708, 0.294, 1.38, 1.664, 0.414, -0.914, 0.0, 1.232),
    (-0.098, 0.572, -1.26, -0.162, 0.168, 0.153, 0.14, 0.155, -0.396, 0.0, 4.761),
)


def weighted(evidence: Tensor) -> tuple[Tensor, Tensor]:
    """Log odds of a bad frame and the log of its error in millimetres, each (F,).

    Args:
        evidence: of each frame, (F, 10), as of ``frame_evidence``.
    """
    deviation = evidence[:, -1:]
    several = evidence[:, FEATURES.index("views")] >= SEVERAL
    lifted = deviation[:, 0].isfinite()
    kind = torch.where(several, 2, torch.where(lifted, 1, 0))
    given = torch.cat((evidence[:, :-1], deviation.nan_to_num(), torch.ones_like(deviation)), -1)
    kinds = (_ONE_VIEW, _LIFTED, _SEVERAL_VIEWS)
    bad, error = (
        (given * given.new_tensor(rows)[kind]).sum(-1)
        for rows in ([each.bad for each in kinds], [each.error for each in kinds])
    )
    return bad, error
