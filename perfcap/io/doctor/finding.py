"""One thing a user should know."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass


class Severity(enum.Enum):
    """How much a finding matters."""

    ERROR = "error"  # capture will fail or be wrong
    WARNING = "warning"  # capture may be worse than it could be
    INFO = "info"


@dataclass(frozen=True)
class Finding:
    """A finding about ``subject`` (a view, file or package): what is so, and what to do."""

    severity: Severity
    subject: str
    what: str
    remedy: str = ""

    def __str__(self) -> str:
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.severity.value}: {self.subject}: {self.what}{remedy}"


def ranges(frames: Sequence[int], limit: int = 6) -> str:
    """Frame numbers as ``3-7, 12``, at most ``limit`` ranges."""
    spans: list[list[int]] = []
    for frame in frames:
        if spans and frame == spans[-1][1] + 1:
            spans[-1][1] = frame
        else:
            spans.append([frame, frame])
    words = [f"{first}" if first == last else f"{first}-{last}" for first, last in spans]
    more = f" and {len(words) - limit} more ranges" if len(words) > limit else ""
    return ", ".join(words[:limit]) + more
