"""Whether confidences of tracks say how sure a network was: a lifter learns what they mean."""

from __future__ import annotations

from pathlib import Path

from torch import Tensor

from perfcap.errors import InputError
from perfcap.io.doctor.faint import examine_faint

# The surest third of the joints, times the least sure third, and share of a person's height; errors
# that know nothing of confidence leave both alike
_FARTHER, _SOME = 1.5, 0.005


def require_surer_nearer(path: Path, confidence: Tensor, apart: Tensor) -> None:
    """Refuse confidences that are next to nothing, or higher of joints that are farther away.

    Args:
        path: that they were read from, for the message.
        confidence: (*b,), 0 where unseen.
        apart: of joints from the truth, (*b,), shares of a person's height.

    Raises:
        InputError: they are.
    """
    for finding in examine_faint("", confidence):
        raise InputError(f"{path}: {finding.what}; {finding.remedy}")
    seen = confidence > 0
    sure, apart = confidence[seen], apart[seen]
    third = len(sure) // 3
    low, high = sure.sort().values[[third, len(sure) - 1 - third]]
    if low == high:  # as of a network that says 1 of all
        return
    least, most = (float(apart[part].median()) for part in (sure <= low, sure >= high))
    if most > max(_SOME, _FARTHER * least):
        raise InputError(
            f"{path}: the surest third of the joints is {most:.1%} of a person's height from the "
            f"truth, the least sure third {least:.1%}; expected higher confidence of surer joints"
        )
