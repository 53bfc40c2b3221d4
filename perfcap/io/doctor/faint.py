"""Confidences that are next to nothing, as of percents that were divided twice."""

from __future__ import annotations

from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity

_FAINT = 0.1  # the most confident joint of a whole clip


def examine_faint(subject: str, confidence: Tensor) -> list[Finding]:
    """Confidences that are all next to nothing: energies and lifters would hardly count them.

    Args:
        subject: of the finding.
        confidence: (*b,), 0 where unseen.
    """
    highest = float(confidence.max()) if confidence.numel() else 0.0
    if not 0 < highest < _FAINT:
        return []
    what = f"confidences are {highest:.2g} at most"
    remedy = (
        "expected shares of up to 1: were percents divided twice, or are they peaks of heat maps "
        "that sum to 1? Divide by what a sure joint has"
    )
    return [Finding(Severity.WARNING, subject, what, remedy)]
