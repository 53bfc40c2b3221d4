"""One thing a user should know."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import torch

from perfcap.detect.detections import Detections


class Severity(enum.Enum):
    """How much a finding matters."""

    ERROR = "error"  # capture will fail or be wrong
    WARNING = "warning"  # capture may be worse than it could be
    INFO = "info"


@dataclass(frozen=True)
class Finding:
    """A finding about ``subject`` (a view, file or package): what is so, and what to do.

    Attributes:
        severity: how much it matters.
        subject: what it is about.
        what: what is so.
        remedy: what to do.
        frames: of the capture, counted from 0, in which it is so; empty of all.
        views: that are wrong in these frames, or one of which is.
    """

    severity: Severity
    subject: str
    what: str
    remedy: str = ""
    frames: tuple[int, ...] = ()
    views: tuple[int, ...] = ()

    def __str__(self) -> str:
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.severity.value}: {self.subject}: {self.what}{remedy}"


def of_view(view: int, findings: Iterable[Finding], *, partly: bool = False) -> list[Finding]:
    """Findings that say that joints of a view are wrong.

    Args:
        view: its number in the capture.
        findings: of it.
        partly: whether they say it of frames that they name alone; else, of all if they name none.
    """
    return [
        found if partly and not found.frames else replace(found, views=(view,))
        for found in findings
    ]


def doubting(detections: Detections, findings: Iterable[Finding]) -> Detections:
    """Detections of which those are doubted, too, that findings say are wrong.

    Args:
        detections: of the capture, (F, C).
        findings: of its inputs.
    """
    wrong = [found for found in findings if found.views]
    if not wrong:
        return detections
    doubted = torch.zeros_like(detections.trusted3d)
    if detections.doubted is not None:
        doubted |= detections.doubted
    for found in wrong:
        there = torch.zeros_like(doubted)
        there[..., found.frames or slice(None), :] = True
        there[..., [view for view in range(detections.views) if view not in found.views]] = False
        doubted |= there
    return replace(detections, doubted=doubted)


def counted(number: int, one: str = "frame", several: str = "") -> str:
    """So many frames, or other things, in words: ``1 frame``, ``2 frames``, ``2 people``."""
    return f"{number} {one}" if number == 1 else f"{number} {several or f'{one}s'}"


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
